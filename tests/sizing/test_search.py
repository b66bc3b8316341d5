"""The search finds what is true of fleets whose truth is known, asks for no more than it needs, and says so where it does not know."""

import random
from dataclasses import replace

import pytest
from fleets import EFFORT, Fleets, question, rises_and_falls

from mrp_sumo.sizing.answer import answer_of
from mrp_sumo.sizing.question import DEMAND, IN_SUMO, SATURATED
from mrp_sumo.sizing.search import Desk, coarse, grid, limits


def within(bracket, truth):
    return (bracket.low is None or bracket.low <= truth) and (bracket.high is None or truth <= bracket.high)


def test_knee_peak_and_collapse_are_bracketed():
    outcome = limits(coarse(Desk(question(), Fleets(rises_and_falls))))
    assert outcome.peak.estimate is not None and within(outcome.peak, 40)
    assert within(outcome.knee, 31)  # 304 of 320, within the noise of its interval
    assert within(outcome.collapse, 45) or abs(outcome.collapse.estimate - 45) <= 4
    assert outcome.first_deadlock is not None and outcome.first_deadlock > 45
    assert outcome.collapse.low > outcome.peak.estimate


def test_the_search_makes_a_third_of_the_runs_of_a_full_grid_of_the_same_precision():
    fleets = Fleets(rises_and_falls)
    desk = Desk(question(), fleets)
    outcome = limits(coarse(desk))
    full = sum(1 for n in range(4, 91) if n % 3 == 1) * max(len(p.records) for p in outcome.curve.points.values())
    assert len(desk.trials) * 3 < full


def test_throughput_that_still_rises_has_no_peak():
    outcome = limits(coarse(Desk(question((4, 25)), Fleets(rises_and_falls))))
    assert outcome.peak.estimate is None and 20 <= outcome.peak.low <= 25 and outcome.peak.high is None
    assert outcome.knee.estimate is None and outcome.collapse.estimate is None


def test_a_dip_before_the_peak_is_reported_and_not_parted():
    outcome = limits(coarse(Desk(question((4, 60)), Fleets(lambda n: 30.0 if 6 < n < 12 else 8.0 * n))))
    assert not outcome.rises
    assert set(outcome.curve.sizes) <= set(grid(question((4, 60))))


@pytest.mark.parametrize("most", [6, 11])
def test_fleets_up_to_the_last_whose_runs_count_are_parted_closely(most):
    """With geometric steps of 1.5 from 4, the runs of 9 count and those of 14 and 20 do not, or none above 6: it is told to 15 %."""

    def audited(trial, fleets=Fleets(rises_and_falls)):  # noqa: B008
        record = fleets(trial)
        return record if trial.robots <= most else record | {"observed": record["observed"] | {"operations": ["robot_1 waits"]}}

    result = limits(coarse(Desk(question(), audited)))
    largest, fails = max(result.curve.points), min(result.curve.unfit)
    assert largest <= most < fails <= max(largest + 1, 1.15 * largest)


@pytest.mark.parametrize("demand_per_h", [100.0, 215.0])
def test_the_smallest_fleet_for_a_demand_is_bracketed(demand_per_h):
    request = question((4, 60), demand_per_h=demand_per_h)
    answer, _ = answer_of(request, Fleets(rises_and_falls, request))
    smallest = answer.served.smallest
    assert smallest.low <= smallest.estimate
    assert 1.0 <= smallest.estimate / (demand_per_h / 10) <= 1.5  # what it takes to keep up, and some more to be on time


def test_a_fleet_whose_runs_at_the_demand_do_not_count_does_not_meet_it():
    request = question((4, 60), demand_per_h=215.0)
    fleets = Fleets(rises_and_falls, request)
    smallest = answer_of(request, fleets)[0].served.smallest.estimate

    def audited(trial):
        record = fleets(trial)
        failed = trial.kind == DEMAND and trial.robots == smallest
        return record | {"observed": record["observed"] | {"operations": ["robot_1 waits"]}} if failed else record

    answer, _ = answer_of(request, audited)
    assert smallest < answer.served.smallest.estimate <= 1.5 * smallest
    assert f"{smallest} robots at the demand: not counted; the operations audit failed: robot_1 waits" in answer.notes


@pytest.mark.parametrize(
    ("least", "words"),
    [(31, "is not met by any fleet that was tried on it, up to 60 robots."), (0, "cannot be told: the runs on it do not count.")],
)
def test_fleets_whose_runs_at_the_demand_do_not_count_were_tried(least, words):
    request = question((4, 60), demand_per_h=298.0)
    fleets = Fleets(rises_and_falls, request)

    def audited(trial):
        record = fleets(trial)
        failed = trial.kind == DEMAND and trial.robots >= least
        return record | {"observed": record["observed"] | {"operations": ["robot_1 waits"]}} if failed else record

    answer, _ = answer_of(request, audited)
    assert f" {words} " in answer.sentence


def test_a_demand_beyond_the_peak_is_met_by_no_fleet():
    request = question((4, 60), demand_per_h=500.0)
    answer, _ = answer_of(request, Fleets(rises_and_falls, request))
    assert answer.served.smallest.estimate is None
    assert "A demand of 500 orders an hour with 95 % of them on time is not met by any fleet" in answer.sentence


@pytest.mark.parametrize(
    ("most", "words"),
    [
        (20, "A demand of 215 orders an hour with 95 % of them on time is not met by any fleet that was tried on it, up to 20 robots."),
        (22, "is met by 22 robots cannot be told: 72 % were on time in 2 runs."),  # of two runs, whose limits hold 95 %
    ],
)
def test_a_demand_that_a_fleet_may_meet_by_its_limits_is_not_said_to_be_unmet(most, words):
    request = question((4, most), replace(EFFORT, seeds=2, most_seeds=2), demand_per_h=215.0)
    served, sentence = (answer := answer_of(request, Fleets(rises_and_falls, request))[0]).served, answer.sentence
    assert sentence.endswith(words) and served.smallest.estimate is None
    assert (served.smallest.low <= most) == ("cannot be told" in sentence)


def test_runs_that_are_too_short_for_orders_to_be_due_decide_nothing():
    request = question((4, 60), replace(EFFORT, horizon_s=150.0), demand_per_h=100.0)  # an order is due after 180 s
    answer, _ = answer_of(request, Fleets(rises_and_falls, request))
    assert answer.served.smallest.estimate is None
    assert "cannot be told" in answer.sentence and any("longer --horizon" in note for note in answer.notes)


def test_the_largest_fleet_whose_plans_succeed():
    request = question((2, 80), replace(EFFORT, most_seeds=20), tasks=None)
    answer, _ = answer_of(request, Fleets(rises_and_falls, request))
    outcome = answer.served.smallest
    assert outcome.low <= outcome.estimate and 36 <= outcome.estimate <= 52  # 80 % succeed at 44
    assert answer.limits is None and answer.document["answer"]["largest_that_succeeds"]["estimate"] == outcome.estimate


def test_what_ifs_are_paired_and_ranked():
    request = question((4, 60), what_if=("planner: pibt", "policy: timed"))
    answer, _ = answer_of(request, Fleets(rises_and_falls, request, {"planner: pibt": 1.12, "policy: timed": 1.0}))
    best, none = answer.gains
    assert best.change == "planner: pibt" and best.share == pytest.approx(0.12, abs=0.02) and best.p_value < 0.01
    assert best.difference.variance_reduction > 0.3
    assert none.p_value > 0.05


def test_a_change_that_cannot_be_driven_says_why():
    request = question((4, 60), what_if=("one_way: [a, b]", "planner: pibt"))
    answer, _ = answer_of(request, Fleets(rises_and_falls, request, {"one_way: [a, b]": None}))
    assert [gain.change for gain in answer.gains] == ["planner: pibt", "one_way: [a, b]"]
    gain = answer.document["answer"]["what_if"][1]
    assert gain["refusal"] == "no robot can reach 'b'" and gain["gain"] is None and gain["gain_per_h"] is None


def test_the_sizes_that_an_answer_names_are_driven_in_sumo_too():
    request = question((4, 60), demand_per_h=150.0, confirm=True)
    plain, _ = answer_of(replace(request, confirm=False), Fleets(rises_and_falls, request))
    fleets = Fleets(rises_and_falls, request, {IN_SUMO: 0.98})
    answer, trials = answer_of(request, fleets)
    in_sumo = {(trial.kind, trial.robots) for trial in trials if trial.change == IN_SUMO}
    limit = answer.limits
    named = {limit.knee.estimate, limit.peak.estimate, limit.collapse.estimate}
    assert in_sumo == {(SATURATED, n) for n in named} | {(DEMAND, answer.served.smallest.estimate)}
    assert all(size.agrees for size in answer.confirmed) and answer.spent_s == plain.spent_s
    slower, _ = answer_of(request, Fleets(rises_and_falls, request, {IN_SUMO: 0.8}))
    knee = next(size for size in slower.confirmed if "knee" in size.name)
    assert not knee.agrees and knee.difference.second == pytest.approx(0.8 * knee.difference.first, rel=0.02)
    assert any("SUMO does not confirm the knee" in note for note in slower.notes)


def test_an_answer_follows_from_finished_runs_alone():
    """Runs come back in any order, a few at a time, as on many cores with interruptions: the same answer, the same runs."""
    request = question((4, 60), demand_per_h=150.0, what_if=("planner: pibt",))
    straight = Fleets(rises_and_falls, request)
    whole, trials = answer_of(request, straight)
    chance, known = random.Random(5), {}
    while True:
        answer, wanted = answer_of(request, known.get)
        if answer:
            break
        missing = [trial for trial in wanted if trial not in known]
        for trial in chance.sample(missing, min(len(missing), 12)):
            known[trial] = straight(trial)
    assert answer.document == whole.document
    assert set(known) == set(trials)


def test_a_budget_that_is_spent_is_said():
    request = question((4, 90), replace(EFFORT, budget_s=150.0), demand_per_h=280.0)
    answer, _ = answer_of(request, Fleets(rises_and_falls, request))
    assert answer.spent_s <= 150.0
    assert any("left out for want of budget: " in note for note in answer.notes)


@pytest.mark.parametrize(("demand_per_h", "first"), [(30.0, True), (60.0, False)])  # of 40 orders an hour that the smallest fleet does
def test_a_demand_that_the_smallest_fleet_has_the_throughput_for_is_tried_before_larger_fleets(demand_per_h, first):
    request = question((4, 60), demand_per_h=demand_per_h)
    fleets = Fleets(rises_and_falls, request)
    answer, order = answer_of(request, fleets)
    larger = next(i for i, trial in enumerate(order) if trial.kind == SATURATED and trial.robots > 4)
    tried = [i for i, trial in enumerate(order) if trial.kind == DEMAND]
    assert all(i < larger for i in tried) == first

    def until_larger(trial):  # the clock is over before a larger fleet was driven
        return fleets(trial) if trial in order[:larger] else None

    closed, _ = answer_of(request, until_larger, closed=True)
    assert (closed.served.smallest == answer.served.smallest) == first
    assert any("larger --budget goes on" in note for note in closed.notes)
