"""Error bands of the number of robots, on fleets whose truth is known."""

from dataclasses import replace
from math import inf

import pytest
from fleets import Fleets, question

from mrp_sumo.sizing.answer import answer_of

STATION = {
    "stations": {"pack": {"places": ["a"]}},
    "groups": {"pick": ["b", "c"]},
    "streams": [{"arrivals": {"rate_per_h": 60.0}, "stops": ["pick", "pack"]}],
}


def answered(per_h, demand_per_h=None, bounds=(), tasks=STATION):
    """The answer about fleets whose throughput is a formula of their number, their speed and the time at `a`."""
    asked = question((4, 60), demand_per_h=demand_per_h, tasks=tasks, bounds=bounds)

    def moved(robots, values):
        return per_h(robots, values.get("max_speed_mps", 1.0), values.get("a", 1.0))

    answer, _ = answer_of(asked, Fleets(lambda n: per_h(n, 1.0, 1.0), asked, moved=moved))
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
        asked = question((4, 60), demand_per_h=200.0, tasks=STATION, bounds=bounds)
        fleets = Fleets(lambda n: 10.0 * n, asked, moved=lambda n, values: 10.0 * n * values.get("max_speed_mps", 1.0))
        answer, _ = answer_of(asked, fleets)
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
