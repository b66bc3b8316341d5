"""Error bands of the number of robots, on fleets whose truth is known."""

from dataclasses import replace
from math import inf
from types import SimpleNamespace

import pytest
from fleets import Fleets, question

from mrp_sumo.experiments.error_bands import Effect, Quantity
from mrp_sumo.experiments.statistics import Interval
from mrp_sumo.sizing.answer import answer_of
from mrp_sumo.sizing.bands import Bands, End, _knee, _sizes_near, likely_trials, stations_of
from mrp_sumo.sizing.question import DEMAND, SATURATED
from mrp_sumo.sizing.reasons import Share
from mrp_sumo.sizing.search import Bracket

STATION = {
    "stations": {"pack": {"places": ["a"]}},
    "groups": {"pick": ["b", "c"]},
    "streams": [{"arrivals": {"rate_per_h": 60.0}, "stops": ["pick", "pack"]}],
}


def answered(per_h, demand_per_h=None, bounds=(), tasks=STATION):
    """The answer about fleets whose throughput is a formula of their number, their speed and the time at `a`."""
    request = question((4, 60), demand_per_h=demand_per_h, tasks=tasks, bounds=bounds)

    def moved(robots, values):
        return per_h(robots, values.get("max_speed_mps", 1.0), values.get("a", 1.0))

    answer, _ = answer_of(request, Fleets(lambda n: per_h(n, 1.0, 1.0), request, moved=moved))
    return answer


def test_where_travel_binds_the_number_goes_with_the_speed():
    answer = answered(lambda n, speed, service: 10.0 * n * speed, demand_per_h=200.0)
    bands, smallest = answer.bands, answer.served.smallest.estimate
    assert bands.answer == "demand" and bands.robots == smallest
    first, *others = bands.effects
    assert first.quantity.name == "the top speed" and first.is_sure
    assert first.change.value == pytest.approx(0.2 * 10 * smallest, rel=0.1)
    assert all(abs(effect.change.value) < 0.2 * first.change.value for effect in others)
    assert bands.fewest == pytest.approx(smallest / 1.1, abs=1.5) and bands.largest == pytest.approx(smallest / 0.9, abs=1.5)
    assert bands.fewest < smallest < bands.largest
    assert f"Between {bands.fewest} and {bands.largest} robots serve the demand" in bands.sentence
    assert "what matters most is the top speed" in bands.sentence


def test_where_a_station_binds_no_fleet_may_do_at_worst():
    answer = answered(lambda n, speed, service: min(110.0 * n * speed, 250.0 / service), demand_per_h=212.0)
    bands = answer.bands
    assert bands.effects[0].quantity.name == "the time at a"
    assert bands.effects[0].change.value == pytest.approx(250.0 * (1 / 1.1 - 1 / 0.9), rel=0.1)
    assert bands.worse.robots is None and bands.largest is None
    assert f"and not even {bands.worse.tried} at worst" in bands.sentence and bands.document["robots"]["high"] is None


def test_without_a_demand_the_knee_is_moved():
    answer = answered(lambda n, speed, service: min(10.0 * n * speed, 300.0 / service))
    bands = answer.bands
    assert bands.answer == "knee" and bands.robots == answer.limits.knee.estimate
    assert bands.fewest <= bands.robots <= bands.largest


def test_an_answer_is_the_same_but_for_its_bands_and_has_none_unless_asked():
    without = answered(lambda n, speed, service: 10.0 * n * speed, demand_per_h=200.0, bounds=None)
    bands = answered(lambda n, speed, service: 10.0 * n * speed, demand_per_h=200.0)
    assert without.bands is None and "error_bands" not in without.document["answer"]
    assert without.document["answer"]["curve"] == bands.document["answer"]["curve"] and without.sentence == bands.sentence
    assert bands.spent_s == without.spent_s < inf


def test_the_runs_that_bands_cost_are_counted_beside_those_of_the_study():
    made = []
    for bounds in (None, ()):
        request = question((4, 60), demand_per_h=200.0, tasks=STATION, bounds=bounds)
        fleets = Fleets(lambda n: 10.0 * n, request, moved=lambda n, values: 10.0 * n * values.get("max_speed_mps", 1.0))
        answer, _ = answer_of(request, fleets)
        made.append(len(set(fleets.made)))
    assert answer.bands.num_runs == made[1] - made[0] > 0


@pytest.mark.parametrize("bounds", [None, ()], ids=("not asked for", "asked for"))
def test_an_answer_without_the_bands_that_were_asked_for_says_so(bounds):
    answer = replace(answered(lambda n, speed, service: 10.0 * n * speed, demand_per_h=200.0, bounds=bounds), bands=None)
    assert any(note.startswith("no error bands: ") for note in answer.notes) == (bounds is not None)


def test_intervals_that_are_given_move_further():
    wide = answered(lambda n, s, _: 10.0 * n * s, demand_per_h=200.0, bounds=(("robots.type.max_speed_mps", (0.11, 0.22)),)).bands
    assert wide.largest == pytest.approx(2 * wide.robots, abs=2)
    assert wide.effects[0].quantity.is_given and "these intervals (10 % up and down where none is known)" in wide.sentence


SPEED = Effect(Quantity("the top speed", ((("robots", "factor", "max_speed_mps"), 0.9, 1.1),), False), Interval(40.0, 30.0, 50.0, 8))
PER_H = Interval(200.0, 190.0, 210.0, 3)
WITHIN = "if your robots and stations are within 10 % up and down of what is assumed; what matters most is the top speed."


@pytest.mark.parametrize(
    ("answer", "worse", "better", "sentence", "low", "high"),
    [
        ("demand", 24, 18, f"Between 18 and 24 robots serve the demand {WITHIN} 20 robots do 181 to 219 orders an hour then.", 18, 24),
        ("knee", 18, 24, f"20 robots do 95 % of the most all the same {WITHIN} 20 robots do 181 to 219 orders an hour then.", 20, 20),
        (
            "demand",
            None,
            None,
            f"20 robots serve the demand at best, and not even 40 at worst, {WITHIN} 20 robots do 181 to 219 orders an hour then.",
            20,
            None,
        ),
        ("unknown", 18, 24, f"20 robots do 181 to 219 orders an hour {WITHIN}", None, None),
    ],
)
def test_bands_say_between_which_numbers_the_answer_is(answer, worse, better, sentence, low, high):
    """The worse ends never need fewer robots than the answer, the better ones never more."""
    bands = Bands(answer, 20, Bracket(20, None, 20), PER_H, (SPEED,), End(181.2, worse, 40), End(218.7, better, 40), 11)
    assert bands.sentence == sentence
    assert bands.document == {
        "sentence": sentence,
        "answer": answer,
        "robots": {"estimate": 20, "low": low, "high": high},
        "throughput_per_h": {"estimate": 200.0, "low": 181.2, "high": 218.7},
        "quantities": [SPEED.document],
        "runs": 11,
    }


def test_throughput_lies_between_the_least_and_the_most_though_chance_has_the_worse_ends_ahead():
    as_is = Interval(180.0, 180.0, 180.0, 3)
    assert Bands("unknown", 20, Bracket(), as_is, (SPEED,), End(181.2, 20, 40), End(178.7, 20, 40), 11).span_per_h == (178.7, 181.2)


def test_bands_are_no_narrower_than_chance_where_nothing_moves():
    as_is = Interval(200.0, 170.0, 230.0, 3)
    bands = Bands("knee", 20, Bracket(20, 17, 25), as_is, (SPEED,), End(181.2, 20, 40), End(218.7, 20, 40), 11)
    assert (bands.fewest, bands.largest, bands.span_per_h) == (17, 25, (170.0, 230.0))
    assert bands.sentence.startswith("Between 17 and 25 robots do 95 % of the most if")


def test_the_busiest_station_speaks_for_its_group_and_idle_ones_are_left_out():
    file = question(tasks=STATION).file
    shares = [Share("station", name, share) for name, share in (("c", 0.9), ("pack", 0.5), ("b", 0.4), ("ship", 0.1), ("idle", 0.0))]
    assert stations_of(file, shares) == ["pick", "pack", "ship"]


def test_bands_cost_a_design_the_answers_size_and_three_sizes_at_either_end():
    """Five quantities are eight settings and their mirror image; four seeds."""
    trials = likely_trials(question(), 20, 5)
    assert [sum(trial.kind == kind for trial in trials) for kind in (SATURATED, DEMAND)] == [16 + 2 * 4, 2 * 3 * 4]
    assert {trial.robots for trial in trials} == {20} and len(set(trials)) == len(trials)


def test_the_knee_is_looked_for_from_half_the_answer_to_twice_and_is_the_first_that_does_enough():
    sizes = [9, 10, 20, 40, 41]
    assert _sizes_near(SimpleNamespace(curve=SimpleNamespace(sizes=sizes)), 20) == [10, 20, 40]
    points = {n: SimpleNamespace(throughput=SimpleNamespace(value=per_h)) for n, per_h in zip(sizes, (94.9, 95.0, 100.0, 99.0, 20.0))}
    assert _knee(SimpleNamespace(sizes=sizes, points=points)) == 10
    assert _knee(SimpleNamespace(sizes=[], points={})) is None
