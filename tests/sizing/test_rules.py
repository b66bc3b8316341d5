"""Each rule of the search on fleets whose runs are known one by one, where it decides one way, and beside it where it decides the other."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from fleets import EFFORT, question, record_with

from mrp_sumo.experiments.statistics import Interval, PairedMeans
from mrp_sumo.sizing.answer import _of_demand, answer_of
from mrp_sumo.sizing.confirmation import Confirmation, _named, most_trials
from mrp_sumo.sizing.points import Point, record_of
from mrp_sumo.sizing.question import DEMAND, SATURATED
from mrp_sumo.sizing.reasons import Reasons, Share
from mrp_sumo.sizing.search import Bracket, Curve, Desk, Served, _guess, _judge, _smallest, coarse, grid, limits, one_shot

FEW = replace(EFFORT, seeds=4, most_seeds=4, gap=9.0)  # the grid alone: nothing is parted, no seeds are added
SURE, VAGUE = (1, -1, 1, -1), (12, -12, 12, -12)  # orders an hour more or less, seed by seed


class Known:
    """Runs that do so many orders an hour: by size, a mean and what seeds are off by."""

    def __init__(self, request, rates, **others):
        self.question, self.rates, self.others = request, rates, others

    def __call__(self, trial):
        mean, off = (self.question.demand_per_h, (0,)) if trial.kind == DEMAND else self.rates[trial.robots]
        per_h = mean + off[trial.seed % len(off)]
        record = record_with(np.arange(1, int(per_h) + 1) * 3600.0 / per_h, 3600.0)
        more = {name: values[trial.robots] for name, values in self.others.items() if trial.robots in values}
        return {**record, "observed": {**record["observed"], **more}}


def limits_of(rates):
    request = question((min(rates), max(rates)), FEW)
    return limits(coarse(Desk(request, Known(request, rates))))


@pytest.mark.parametrize(("off", "falls"), [(SURE, True), (VAGUE, False)])
def test_a_size_below_the_level_is_a_collapse_only_where_its_interval_says_so(off, falls):
    result = limits_of({4: (150, SURE), 6: (200, SURE), 9: (184, off)})
    assert result.curve.best == 6
    assert result.collapse.estimate == (9 if falls else None)


@pytest.mark.parametrize(("off", "low"), [(SURE, 5), (VAGUE, None)])
def test_the_knee_begins_above_a_size_only_where_its_interval_is_below_the_level(off, low):
    result = limits_of({4: (184, off), 6: (200, SURE), 9: (196, SURE)})
    assert (result.knee.estimate, result.knee.low, result.knee.high) == (6, low, 6)


@pytest.mark.parametrize(("three", "knee"), [(108, 3), (98, None)])
def test_the_knee_is_looked_for_below_the_largest_fleet_that_is_asked_about_too(three, knee):
    """A station takes 109 an hour: three robots do as much as four, which the grid of 1, 2 and 4 cannot tell, or do not."""
    request = question((1, 4), replace(FEW, growth=2.0, gap=1.1))
    rates = {1: (43, SURE), 2: (87, SURE), 3: (three, SURE), 4: (109, SURE)}
    assert limits(coarse(Desk(request, Known(request, rates)))).knee.estimate == knee


@pytest.mark.parametrize(("mean", "high"), [(198, None), (194, 8)])
def test_the_peak_may_be_at_a_size_that_is_worse_by_chance(mean, high):
    """2 fewer of 200, with seeds that are 4 off, is p = 0.4; 6 fewer is p = 0.03."""
    result = limits_of({4: (150, SURE), 6: (200, (0, 0, 0, 0)), 9: (mean, (4, -4, 4, -4))})
    assert result.curve.best == 6 and result.peak.high == high and result.collapse.estimate is None


def test_gaps_are_halved_around_the_peak_and_where_the_collapse_begins():
    """180 an hour at 9, about as much up to 14, and less and less above."""
    rates = {n: (20 * n if n <= 9 else 180 - n / 2 if n <= 14 else 300 - 9 * n, SURE) for n in range(4, 31)}
    request = question((4, 30), replace(FEW, gap=1.4))
    sizes = limits(coarse(Desk(request, Known(request, rates)))).curve.sizes
    assert {4, 6, 9, 14, 20, 30} < set(sizes) and {7, 11, 17} < set(sizes)


@pytest.mark.parametrize(("off", "low"), [(SURE, 5), (VAGUE, 4)])
def test_a_fleet_is_ruled_out_by_the_upper_limit_of_what_it_can_do(off, low):
    """184 orders an hour of 200 that come, of which 95 % are wanted: 190."""
    request = question((4, 9), FEW, demand_per_h=200.0)
    answer, _ = answer_of(request, Known(request, {4: (184, off), 6: (300, SURE), 9: (300, SURE)}))
    assert answer.served.smallest.low == low


@pytest.mark.parametrize(
    ("four", "nine", "smallest", "words"),
    [
        (184, 300, Bracket(9, 4, 9), "is met from 9 robots on (4 to 9)."),
        (
            184,
            184,
            Bracket(None, 4, None),
            "by 4 robots cannot be told: they do it in runs this short, but 185 when work is always waiting.",
        ),
        (192, 300, Bracket(4, 4, 4), "is met from 4 robots on."),
    ],
)
def test_a_fleet_that_does_less_with_work_always_waiting_is_not_said_to_meet_a_demand(four, nine, smallest, words):
    """Four robots do the 200 orders that come in an hour, 95 % of which are wanted, from full batteries."""
    rates = {4: (four, VAGUE), 9: (nine, VAGUE)}
    request = question((4, 9), FEW, demand_per_h=200.0)
    saturated = Curve(Desk(request, Known(request, rates)), SATURATED)
    saturated.ask(dict.fromkeys(rates, 4), "")
    served = Served(saturated, Bracket(4, 4, 4), 0.95).beside(saturated)
    assert served.smallest == smallest
    assert _of_demand(served, request, 9).endswith(words)


def test_the_smallest_fleet_is_not_looked_for_below_those_that_are_asked_about():
    tried = []
    curve = SimpleNamespace(desk=SimpleNamespace(question=question((10, 20), replace(EFFORT, gap=1.1))), sizes=[], points={})
    assert _smallest(lambda n: tried.append(n) or (1 if n >= 11 else -1), None, curve, (10, 20), 11) == Bracket(11, 10, None)
    assert tried == [11, 10]


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [(5, 6, "6 robots on (5 to 6)."), (5, None, "6 robots on (5 or more)."), (6, None, "6 robots on (or more)."), (6, 6, "6 robots on.")],
)
def test_a_fleet_for_the_demand_that_is_not_sure_is_said_to_be_open_above(low, high, words):
    request = question((4, 9), FEW, demand_per_h=200.0)
    answer, _ = answer_of(request, Known(request, {4: (150, SURE), 6: (200, SURE), 9: (200, SURE)}))
    served = replace(answer.served, smallest=replace(answer.served.smallest, low=low, high=high))
    assert replace(answer, served=served).sentence.endswith(words)


def test_equal_counts_have_limits_too():
    """116 orders in 3481 s, once four robots have done one each."""
    point = Point(4, 3600.0, tuple(record_with(np.arange(1, 121) * 30.0 - 1.0, 3600.0) for _ in range(3)))
    limits = point.throughput
    assert limits.value == pytest.approx(116 * 3600 / 3481)
    assert limits.high - limits.value == pytest.approx(4.303 * 0.5 * (3600 / 3481) / 3**0.5, rel=1e-3)


@pytest.mark.parametrize(("robots", "per_h"), [(1, 43.2), (14, 42.0), (15, 42.0)])
def test_the_first_round_of_a_fleet_is_warm_up(robots, per_h):
    """One robot goes round a ring in 83 s, 43.4 times an hour, and begins anywhere before the place where an order begins: 42 in all.

    A fleet that has not done an order a robot by the middle of the run is measured in its second half alone.
    """
    runs = tuple(record_with(np.arange(55.0 + before_s, 1200.0, 83.0), 1200.0) for before_s in np.linspace(2.0, 38.0, 10))
    point = Point(robots, 1200.0, runs)
    assert point.warm_up_s == (pytest.approx(75.0) if robots == 1 else 600.0)
    assert point.throughput.value == pytest.approx(per_h, abs=0.01)


def test_lead_times_are_those_of_orders_done_after_the_warm_up_and_of_runs_that_did_some():
    """Orders take a minute, but for the first, which take less; a third run does none."""
    runs = tuple(record_with(np.arange(1, 121) * 30.0 - 1.0, 3600.0) for _ in range(2))
    point = Point(4, 3600.0, (*runs, record_with([], 3600.0)))
    assert (point.p95_s.value, point.p95_s.count) == (60.0, 2)


def test_sizes_are_measured_on_other_runs_than_they_were_chosen_on():
    """Size 9 is lucky on the seeds that choose, by 30, and only there."""
    request = question((4, 9), FEW)
    runs = Known(request, {4: (150, SURE), 6: (200, SURE), 9: (200, SURE)})

    def lucky(trial):
        if trial.robots == 9 and trial.seed < 1000:
            return Known(request, {9: (230, SURE)})(trial)
        return runs(trial)

    result = limits(coarse(Desk(request, lucky)))
    assert result.curve.best == 9 and result.measured
    assert result.curve.points[9].throughput.value == pytest.approx(200, abs=1) and result.curve.points[9].first_seed == 1000


@pytest.mark.parametrize(("unanswered", "counts"), [(1, True), (2, False)])
def test_a_size_counts_where_at_most_one_request_of_a_hundred_went_unanswered(unanswered, counts):
    request = question((4, 9), FEW)
    curve = coarse(Desk(request, Known(request, {4: (150, SURE), 6: (200, SURE), 9: (230, SURE)}, requests={9: [100, unanswered]})))
    assert (9 in curve.points) == counts
    if not counts:
        assert curve.unfit[9].fault == "the planner found no plan in 8 of 400 requests: not a property of your floor"


def test_the_next_planner_is_tried_where_the_first_has_no_plans():
    request = question((4, 9), FEW)
    runs = Known(request, {4: (150, SURE), 6: (200, SURE), 9: (203, SURE)})

    def refused(trial):
        record = runs(trial)
        return record if trial.planner or trial.robots < 6 else {**record, "observed": {**record["observed"], "requests": [52, 52]}}

    answer, trials = answer_of(request, refused)
    assert answer.planner == "auto" and not answer.unfit and {t.planner for t in trials} == {"", "auto"}
    assert any("planned with auto, since lacam left more than 1 % of its requests unanswered" in note for note in answer.notes)


def test_without_a_planner_that_answers_there_is_no_headline():
    request = question((4, 9), FEW)
    rates = dict.fromkeys((4, 6, 9), (150, SURE))
    answer, _ = answer_of(request, Known(request, rates, requests={n: [52, 52] for n in rates}))
    result = answer.document["answer"]
    assert result["sentence"] == "No answer: with 4 robots the planner found no plan in 208 of 208 requests: not a property of your floor."
    assert result["limit"]["kind"] == "planner" and result["knee_robots"]["estimate"] is None
    assert [row["unanswered_share"] for row in result["curve"]] == [1.0]


def test_a_size_of_which_a_run_failed_the_operations_audit_does_not_count():
    request = question((4, 9), FEW)
    rates = {4: (150, SURE), 6: (200, SURE), 9: (260, SURE)}
    answer, _ = answer_of(request, Known(request, rates, operations={9: ["station A served two robots at 50 s"]}))
    assert answer.limits.curve.best == 6
    assert any("9 robots: not counted; the operations audit failed: station A served two robots at 50 s" in note for note in answer.notes)


@pytest.mark.parametrize(("bad_seed", "best"), [(1003, 6), (2003, 9)])
def test_a_size_of_which_a_run_on_new_seeds_failed_the_operations_audit_does_not_count(bad_seed, best):
    request = question((4, 9), FEW)
    runs = Known(request, {4: (150, SURE), 6: (200, SURE), 9: (260, SURE)})

    def failing(trial):
        record = runs(trial)
        bad = trial.robots == 9 and trial.seed == bad_seed
        return {**record, "observed": {**record["observed"], "operations": ["station A served two robots at 50 s"]}} if bad else record

    answer, _ = answer_of(request, failing)
    assert (answer.limits.curve.best, answer.limits.measured) == (best, True)
    assert [point.robots for point in answer.unfit] == ([9] if best == 6 else [])


@pytest.mark.parametrize("stalls", [False, True])
def test_runs_in_which_work_came_to_a_stand_are_said(stalls):
    request = question((4, 9), FEW)
    runs = Known(request, {4: (150, SURE), 6: (200, SURE), 9: (260, SURE)})

    def standing(trial):
        return {**runs(trial), "status": "stalled" if stalls and (trial.robots, trial.seed % 1000) == (6, 2) else "completed"}

    notes = answer_of(request, standing)[0].notes
    said = "work came to a stand for good in 1 of 4 runs with 6 robots, which count with what they did until then"
    assert (said in notes) == stalls and any("came to a stand" in note for note in notes) == stalls


def test_a_study_in_whose_runs_no_order_was_done_says_so_instead_of_a_size():
    request = question((4, 9), FEW)
    answer, _ = answer_of(request, Known(request, dict.fromkeys((4, 6, 9), (0.5, (0,)))))
    assert answer.sentence.startswith("No order was done in runs of 1 h: a longer --horizon may tell.")
    assert answer_of(request, Known(request, dict.fromkeys((4, 6, 9), (5, (0,)))))[0].sentence.startswith("4 robots")


@pytest.mark.parametrize(("empty_s", "per_h"), [(None, 120.0), (1800.0, 240.0)])
def test_what_is_driven_after_a_battery_ran_empty_is_not_throughput(empty_s, per_h):
    """240 orders an hour for half an hour, and none after that."""
    record = record_with(np.arange(1, 121) * 15.0, 3600.0)
    batteries = {"empty_s": empty_s, "empty": 1, "charging": 0.0, "most_charging": 0, "places": 0}
    record = {**record, "observed": {**record["observed"], "batteries": batteries if empty_s else None}}
    point = Point(4, 3600.0, (record, record))
    assert point.until_s == (empty_s or 3600.0)
    assert point.per_h.tolist() == pytest.approx([per_h] * 2, abs=3) if empty_s else point.per_h.max() < 240


@pytest.mark.parametrize(("is_made", "words"), [(False, "by 4 robots; larger fleets were not tried on it."), (True, "from 5 robots on.")])
def test_a_demand_on_which_larger_fleets_were_not_tried_is_not_said_to_be_met_by_none(is_made, words):
    """Orders take 10 min with 4 robots, three times too long. The clock ends the study before larger fleets are tried, or it does not."""
    request = question((4, 9), FEW, demand_per_h=170.0)
    runs = Known(request, {4: (180, SURE), 5: (220, SURE), 6: (240, SURE), 9: (240, SURE)})

    def made(trial):
        if trial.kind != DEMAND or trial.robots > 4:
            return runs(trial) if trial.kind != DEMAND or is_made else None
        record = runs(trial)
        return {**record, "observed": {**record["observed"], "released_s": record["observed"]["done_s"] - 600.0}}

    answer, _ = answer_of(request, made, closed=True)
    assert answer.sentence.endswith(words), answer.sentence


def ran_empty(places):
    """Of a run in which two robots ran empty after 3 min."""
    return {"empty_s": 180.0, "empty": 2, "charging": 1.0, "most_charging": 1, "places": places}


@pytest.mark.parametrize(("places", "counts"), [(2, False), (0, True)])
def test_a_size_in_whose_runs_robots_that_can_charge_ran_empty_does_not_count(places, counts):
    """Before they did, 200 orders an hour were done; and what binds is the charger."""
    request = question((4, 6), FEW)
    runs = Known(request, {4: (150, SURE), 6: (200, SURE)}, causes={6: [["charger", "p1", 60.0, 0.9]]})

    def one_ran_empty(trial):
        record, empty = runs(trial), trial.robots == 6 and trial.seed == 2
        return {**record, "observed": {**record["observed"], "batteries": ran_empty(places)}} if empty else record

    answer, _ = answer_of(request, one_ran_empty)
    assert [point.robots for point in answer.points] == ([4, 6] if counts else [4])
    if not counts:
        assert answer.unfit[0].fault == "batteries ran empty in 1 of 4 runs: places to charge are too few or too far"
        assert "With 6 robots batteries ran empty in 1 of 4 runs" in answer.sentence
        assert answer.document["answer"]["limit"] == {"kind": "charger", "name": "p1", "utilisation": 0.9}


@pytest.mark.parametrize(
    ("first_unfit", "why", "sizes"),
    [
        (8, {"batteries": ran_empty(2)}, [4, 6, 7]),
        (11, {"batteries": ran_empty(2)}, [4, 6, 9, 10]),
        (8, {"operations": ["station A served two robots at 50 s"]}, [4, 6, 7]),
    ],
)
def test_where_runs_begin_not_to_count_is_looked_for(first_unfit, why, sizes):
    request = question((4, 14), replace(FEW, gap=1.1))
    runs = Known(request, {n: (20 * n, SURE) for n in range(4, 15)})

    def observed(trial):
        record = runs(trial)
        return {**record, "observed": {**record["observed"], **why}} if trial.robots >= first_unfit else record

    answer, _ = answer_of(request, observed)
    assert [point.robots for point in answer.points] == sizes
    if "batteries" in why:
        assert answer.sentence.startswith(f"More robots bring more up to {first_unfit - 1}, the most that count: ")


def test_a_study_that_is_closed_answers_from_what_there_is():
    request = question((4, 9), FEW)
    runs = Known(request, {4: (150, SURE), 6: (200, SURE), 9: (203, SURE)})
    whole, _ = answer_of(request, lambda trial: runs(trial) if trial.robots < 9 and trial.seed < 3 else None, closed=True)
    assert [(p.robots, len(p.records)) for p in whole.points] == [(4, 3), (6, 3)] and not whole.in_time
    assert "the answer is from those that were" in whole.notes[0]
    nothing, _ = answer_of(request, lambda trial: None, closed=True)
    assert nothing.sentence.startswith("Nothing is known") and nothing.document["answer"]["limit"] is None


def test_a_study_that_is_closed_where_limits_are_still_wide_asks_for_no_more():
    request = question((4, 9), replace(FEW, most_seeds=12))
    runs = Known(request, {4: (150, SURE), 6: (200, VAGUE), 9: (192, VAGUE)})
    answer, trials = answer_of(request, lambda trial: runs(trial) if trial.seed < 4 else None, closed=True)
    assert {trial.seed for trial in trials} == {0, 1, 2, 3} and not answer.limits.measured
    assert any(note.startswith("left out for want of budget: closer limits; new runs") for note in answer.notes)
    more, trials = answer_of(request, runs)
    assert {trial.seed for trial in trials} > {0, 1, 2, 3} and more.limits.measured


@pytest.mark.parametrize(
    ("horizon_s", "empty_s", "why"), [(90.0, None, "1.5 min are too short"), (3600.0, 90.0, "ran empty after 1.5 min")]
)
def test_a_size_with_too_little_to_measure_says_whether_the_horizon_or_a_battery_ended_it(horizon_s, empty_s, why):
    record = record_with(np.zeros(0), horizon_s)
    batteries = {"empty_s": empty_s, "empty": 1, "charging": 0.0, "most_charging": 0, "places": 0}
    record = {**record, "observed": {**record["observed"], "batteries": batteries}}
    assert why in Point(1, horizon_s, (record,)).fault


@pytest.mark.parametrize(("status", "what"), [("audit_failed", "audit failed"), ("timed_out", "timed out")])
def test_a_size_says_what_became_of_its_runs_that_do_not_count(status, what):
    whole = record_with(np.arange(1, 121) * 30.0, 3600.0)
    broken = {**whole, "status": status, "reason": "the order was never made"}
    assert Point(1, 3600.0, (whole, broken)).fault == f"1 of 2 runs do not count: {what}: the order was never made"
    assert Point(1, 3600.0, (whole, whole)).fault == ""


@pytest.mark.parametrize(("kinds", "binds"), [(("fleet", "fleet", "aisle"), "aisle"), (("aisle", "station", "aisle"), "station")])
def test_a_fleet_binds_only_where_larger_ones_are_not_kept_from_more(kinds, binds):
    answer, _ = answer_of(question((4, 9), FEW), Known(question((4, 9), FEW), {4: (150, SURE), 6: (200, SURE), 9: (192, SURE)}))
    of_size = tuple(Reasons(n, Share(kind, "", 0.9), (), (), Share("fleet", "", 0.9), ()) for n, kind in zip((4, 6, 9), kinds))
    assert answer.limits.curve.best == 6 and replace(answer, reasons=of_size).limit.kind == binds
    assert replace(answer, reasons=tuple(replace(each, limit=each.fleet) for each in of_size)).limit.kind == "fleet"


@pytest.mark.parametrize(
    ("sizes", "most", "growth", "expected"),
    [
        ((4, 90), 90, 1.5, [4, 6, 9, 14, 20, 30, 46, 68, 90]),
        ((1, 9), 4, 1.2, [1, 2, 3, 4]),  # by one at least
        ((4, 9), 4, 1.5, [4]),
        ((5, 9), 4, 1.5, []),
    ],
)
def test_the_coarse_grid_is_geometric_up_to_what_can_be_kept_going(sizes, most, growth, expected):
    assert grid(SimpleNamespace(sizes=sizes, most_robots=most, effort=SimpleNamespace(growth=growth))) == expected


@pytest.mark.parametrize(
    ("per_h", "guess"),
    [
        ({10: 80, 20: 120}, 16),  # half of the way from 10 to 20, rounded up
        ({10: 120}, 9),  # from nothing without robots
        ({10: 100, 20: 120}, 10),
        ({10: 80, 20: 90}, 20),  # none does it: the best
        ({10: 400}, 4),
        ({30: 100.1, 20: 10}, 25),
    ],
)
def test_a_fleet_for_a_demand_is_guessed_straight_between_sizes_within_those_that_are_asked_about(per_h, guess):
    points = {n: SimpleNamespace(throughput=SimpleNamespace(value=value)) for n, value in per_h.items()}
    curve = SimpleNamespace(points=points, sizes=sorted(points), best=max(points, key=per_h.get, default=0))
    assert _guess(curve, SimpleNamespace(sizes=(4, 25), most_robots=25, demand_per_h=100.0)) == guess


@pytest.mark.parametrize("enough", [4, 5, 9, 17, 40, 41])
@pytest.mark.parametrize("guess", [4, 12, 40])
def test_the_smallest_of_all_fleets_is_found_to_the_gap_from_any_guess(enough, guess):
    """Of 4 to 40 robots, so many serve the demand; a tenth between what does and what does not is near enough."""
    points, effort = {}, replace(EFFORT, gap=1.2)
    curve = SimpleNamespace(desk=SimpleNamespace(question=question((4, 40), effort)), points=points, sizes=[])

    def judge(n):
        points[n] = Interval(share := float(n >= enough), share - 0.01, share + 0.01, 4)
        curve.sizes = sorted(points)
        return 1 if n >= enough else -1

    bracket = _smallest(judge, lambda point: point, curve, (4, 40), guess)
    if enough > 40:
        assert bracket == Bracket(None, 41, None) and max(points) == 40
        return
    no = max((n for n in points if n < enough), default=3)
    assert bracket == Bracket(min(n for n in points if n >= enough), no + 1, bracket.estimate)
    assert bracket.estimate <= max(no + 1, round(no * 1.1)) and len(points) <= 11


@pytest.mark.parametrize(
    ("verdict", "share", "estimate"),
    [(0, 0.95, 9), (0, 0.94, None)],
    ids=("undecided and reached on the mean", "undecided and not reached"),
)
def test_where_it_stays_undecided_the_mean_decides(verdict, share, estimate):
    curve = SimpleNamespace(desk=SimpleNamespace(question=question((9, 9))), points={9: None}, sizes=[9])
    mean = Interval(share, share - 0.1, share + 0.1, 4)
    assert _smallest(lambda n: verdict, lambda point: mean, curve, (9, 9), 9) == Bracket(estimate, 9, None)


@pytest.mark.parametrize(
    ("intervals", "seeds", "verdict"),
    [
        ([(0.96, 0.95, 0.97)], [4], 1),
        ([(0.93, 0.92, 0.949)], [4], -1),
        ([(0.96, 0.94, 0.98), (0.94, 0.93, 0.95), (0.96, 0.95, 0.97)], [4, 6, 7], 1),
        ([(0.96, 0.94, 0.98)] * 3, [4, 6, 7], 0),
        ([(float("nan"),) * 3], [4], None),
    ],
)
def test_seeds_are_added_two_at_a_time_until_the_interval_decides(intervals, seeds, verdict):
    asked_for, left = [], list(intervals)
    curve = SimpleNamespace(points={9: None}, seeds=lambda n: 0)
    curve.ask = lambda wanted, reason: asked_for.append(wanted[9]) or True
    output = _judge(curve, 9, replace(EFFORT, seeds=4, most_seeds=7), "", lambda point: Interval(*left.pop(0), 4), 0.95)
    assert (output, asked_for) == (verdict, seeds)


def test_sizes_that_do_not_count_or_cannot_be_paid_for_are_told_apart():
    curve = SimpleNamespace(points={}, seeds=lambda n: 0, ask=lambda wanted, reason: True)
    assert _judge(curve, 9, EFFORT, "", None, 0.95) == -1
    curve.ask = lambda wanted, reason: False
    assert _judge(curve, 9, EFFORT, "", None, 0.95) is None
    curve.points[9] = None
    assert _judge(curve, 9, EFFORT, "", None, 0.95) == 0


@pytest.mark.parametrize("most", [3, 4, 11, 29, 40])
def test_the_largest_fleet_whose_plans_succeed_is_found_to_the_gap(most):
    request = question((4, 40), replace(EFFORT, gap=1.1), tasks=None)
    made = []

    def recorded(trial):
        made.append(trial.robots)
        return {"success": trial.robots <= most, "status": "completed", "observed": None}

    served = one_shot(Desk(request, recorded)).smallest
    sizes = set(made)
    good = max((n for n in sizes if n <= most), default=None)
    fails = min((n for n in sizes if n > most), default=None)
    assert served.estimate == good and served.high == (None if fails is None else fails - 1)
    assert fails is None or good is None or fails <= max(good + 1, good * 1.1)


def orders(released_s, done_s, due_s=None):
    """A run with these orders."""
    times = {"released_s": released_s, "done_s": done_s, "due_s": due_s or [None] * len(done_s), "assigned_s": released_s}
    usual = {"stations": {}, "vertices": [], "minutes": [], "deadlocks": 0, "planning_share": 0.0, "steady_s": 0.0}
    return record_of({"status": "completed", "success": True, "metrics": {}, "observed": {**usual, **times}})


@pytest.mark.parametrize(
    ("released_s", "done_s", "due_s", "share"),
    [
        ([199, 200, 500, 900, 1001], [999, 350, 651, 960, 1002], None, 1 / 2),  # the first is not asked; two are due in time
        ([199, 200, 500, 900, 1001], [999, 350, 651, 960, 1002], [None, None, None, 950, None], 1 / 3),
        ([200, 900, 900, 900], [300, 910, 910, 910], None, 1.0),  # one of four says something
        ([200, 900, 900, 900, 900], [300, 910, 910, 910, 910], None, np.nan),
        ([200, 850], [None, 1000], None, 1 / 2),  # never done is late
        ([900], [910], None, np.nan),
    ],
)
def test_orders_are_punctual_that_are_done_when_due_of_those_due_in_the_run(released_s, done_s, due_s, share):
    """A run of 1000 s, of which 200 s fill the floor; without due times 150 s are allowed."""
    point = Point(4, 1000.0, (orders(released_s, done_s, due_s), {"status": "bad_input", "observed": None}))
    assert point.punctual(150.0) == pytest.approx([share, np.nan], nan_ok=True)
    assert point.has_due_times == (due_s is not None)


def test_orders_are_counted_in_sixty_parts_of_the_time_that_counts():
    """One a minute for an hour; in another run one at the end, and one that is never done."""
    minutes = (np.arange(60) * 60.0 + 30.0).tolist()
    point = Point(4, 3600.0, (orders(minutes, minutes), orders([0.0, 9.0], [3600.0, None])))
    assert point.series.tolist() == [0.5] * 59 + [1.0] and point.num_done == 61
    assert Point(4, 3600.0, ({"observed": None, "status": "bad_input"},)).series.tolist() == [0.0] * 60


@pytest.mark.parametrize(
    ("value", "low", "high", "agrees"), [(-9.0, -20.0, 1.0, True), (9.0, 0.0, 18.0, True), (5.0, 4.0, 6.0, True), (-5.1, -6.0, -4.0, False)]
)
def test_engines_agree_where_they_differ_by_chance_or_by_a_twentieth(value, low, high, agrees):
    difference = PairedMeans(100.0, 100.0 + value, Interval(value, low, high, 3), 0.5, 0.0)
    assert Confirmation("peak", 9, "throughput_per_h", difference).agrees == agrees


@pytest.mark.parametrize(
    ("knee", "peak", "collapse", "served", "names"),
    [
        (6, 9, 14, 5, [("knee", 6), ("peak", 9), ("collapse", 14), ("demand", 5)]),
        (9, 9, None, None, [("knee, peak", 9)]),
        (None, None, None, None, [("largest tried", 9)]),
    ],
)
def test_each_size_that_an_answer_names_is_driven_again_once(knee, peak, collapse, served, names):
    curve = SimpleNamespace(points={9: None}, best=9, kind=DEMAND)
    limit = SimpleNamespace(curve=curve, knee=Bracket(knee), peak=Bracket(peak), collapse=Bracket(collapse))
    assert [(name, n) for name, _, n, _ in _named(limit, Served(curve, Bracket(served), 0.95))] == names
    assert [name for name, *_ in _named(None, Served(curve, Bracket(5), 0.95))] == ["largest"]
    assert [len(most_trials(has_tasks, 9)) for has_tasks in (True, False)] == [12, 3]
