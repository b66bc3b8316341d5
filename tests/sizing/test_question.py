"""The runs of a capacity study."""

from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import pytest

from mrp_sumo.cli.capacity import _watcher
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.batch import Making
from mrp_sumo.io.scenario.read import read_scenario
from mrp_sumo.sizing import study
from mrp_sumo.sizing.question import DEMAND, QUICK, SATURATED, Cycle, Question, Trial, values_of
from mrp_sumo.sizing.search import grid
from mrp_sumo.sizing.study import Pilot, Study, driving_cpu_s


@pytest.mark.parametrize(("robots", "counts"), [(1, [1]), (2, [1, 1]), (5, [3, 2]), (10, [6, 4]), (33, [20, 13])])
def test_a_mixed_fleet_grows_in_the_shares_of_its_types(tmp_path, robots, counts):
    fleet = "[{type: turtlebot3, count: 6}, {type: amr_600, count: 4}]"
    (tmp_path / "mixed.yaml").write_text(f"map: office\nrobots: {fleet}\n")
    question = Question(read_scenario(tmp_path / "mixed.yaml"), (1, 40), QUICK)
    (_, groups) = values_of(Trial(SATURATED, robots, 0), question, {})[("robots", "fleet")]
    assert [group["count"] for group in groups] == counts


@pytest.mark.parametrize(("charge_s", "most"), [(100.0, 6), (101.0, 5), (99.0, 6)])
def test_places_to_charge_keep_as_many_robots_going_as_they_charge_in_time(charge_s, most):
    assert Cycle(100.0, charge_s, 3).most_robots == most


@pytest.mark.parametrize(("robots", "least"), [(1, 1), (3, 3), (5, 4)])
def test_fleets_as_small_as_the_scenarios_own_are_tried(tmp_path, robots, least):
    tasks = "{streams: [{arrivals: {rate_per_h: 60}, stops: [office_1]}]}"
    (tmp_path / "small.yaml").write_text(f"map: office\nrobots: {robots}\ntasks: {tasks}\n")
    assert study.completed(Question(read_scenario(tmp_path / "small.yaml"))).sizes[0] == least


@pytest.mark.parametrize(("robots", "is_refused"), [((0, 2), True), ((5, 2), True), ((2, 2), False)])
def test_sizes_are_checked_whoever_asks(tmp_path, robots, is_refused):
    (tmp_path / "small.yaml").write_text("map: office\nrobots: 2\n")
    file = read_scenario(tmp_path / "small.yaml")
    with pytest.raises(MrpSumoError, match="at least one robot") if is_refused else nullcontext():
        assert study.completed(Question(file, robots)).sizes == robots


CHARGING = """
map: office
robots: 4
tasks:
  streams: [{arrivals: {rate_per_h: 60}, stops: [office_1]}]
  charging: {stations: [charger_1], critical_low_charging_level: 20, maximum_desired_charging_level: 90}
"""


@pytest.mark.parametrize(("robots", "share"), [(4, 25.0), (8, 12.5)])
@pytest.mark.parametrize("kind", [SATURATED, DEMAND])
def test_runs_begin_at_all_points_of_driving_and_charging(tmp_path, robots, share, kind):
    """A charge takes a quarter of the cycle: a quarter of four robots begin with one; of eight, as many as there are places."""
    (tmp_path / "charging.yaml").write_text(CHARGING)
    file = read_scenario(tmp_path / "charging.yaml")
    question = Question(file, (1, 40), QUICK, 60.0, charging=Cycle(3000.0, 1000.0, 1, 0.9))
    charging = values_of(Trial(kind, robots, 0), question, {})["tasks",][1]["charging"]
    assert (charging["start_level"], charging["start_charging"]) == ([20.0, 90.0], share)
    assert charging["stations"] == ("charger_1",)


@pytest.mark.parametrize(("minimum", "policy", "highest"), [(50, "threshold", 0.9), (50, "opportunity", 0.5)])
def test_a_cycle_ends_at_the_level_from_which_robots_are_called_off(tmp_path, monkeypatch, minimum, policy, highest):
    """With orders always waiting `opportunity` never charges to the maximum: a cycle is from the critical level to the minimum."""
    extra = f"{{policy: {policy}, minimum_desired_charging_level: {minimum}, stations"
    (tmp_path / "charging.yaml").write_text(CHARGING.replace("{stations", extra))
    question = Question(read_scenario(tmp_path / "charging.yaml"), (1, 2), QUICK, 60.0)
    monkeypatch.setattr(Study, "pilot", Pilot(2, 1.0, 10.0))
    cycle = Study(question).charged.charging
    battery = Study(question).setup.problem.fleet.batteries[0]
    assert (cycle.highest, cycle.places) == (highest, 1)
    assert cycle.drive_s == pytest.approx((highest - 0.2) * battery.energy_j / 10.0)
    assert cycle.charge_s == pytest.approx(battery.charge_s(highest - 0.2))
    for kind, level in ((SATURATED, 100 * highest), (DEMAND, 90.0)):  # with pauses robots charge to the maximum
        levels = values_of(Trial(kind, 1, 0), replace(question, charging=cycle), {})["tasks",][1]["charging"]["start_level"]
        assert levels == [20.0, pytest.approx(level)]


@pytest.mark.parametrize(("places", "sizes"), [(1, [1, 2, 4]), (None, [1, 2, 4, 8])])
def test_fleets_that_places_to_charge_do_not_keep_going_are_not_tried(tmp_path, places, sizes):
    (tmp_path / "charging.yaml").write_text(CHARGING)
    cycle = Cycle(3000.0, 1000.0, places) if places else None
    assert grid(Question(read_scenario(tmp_path / "charging.yaml"), (1, 8), QUICK, charging=cycle)) == sizes


@pytest.mark.slow
def test_what_confirms_is_made_when_the_budget_is_over(tmp_path, monkeypatch):
    (tmp_path / "one.yaml").write_text(CHARGING.partition("  charging")[0])
    effort = replace(QUICK, horizon_s=240.0)
    question = Question(read_scenario(tmp_path / "one.yaml"), (1, 2), effort, confirm=True)
    folder = tmp_path / "new"
    monkeypatch.setattr(study, "monotonic", lambda: 1e9 if len(list(folder.glob("runs/*/*.json"))) >= 2 * effort.seeds else 0.0)
    answer = Study(question).run(folder, _watcher(), Making(1))
    assert not answer.in_time and [size.name for size in answer.confirmed]


def test_a_pilot_is_measured_once_what_it_needs_is_loaded(tmp_path, monkeypatch):
    """The first run takes 9 s of CPU time to load kernels; the second takes twice as long as predicted."""
    (tmp_path / "charging.yaml").write_text(CHARGING)
    took_s = iter([9.0, 2 * driving_cpu_s(2, 120.0)])

    def driven(file, maps):
        execution = SimpleNamespace(sim_time_s=file.scenario.execution.time_limit_s, cpu_time_s=next(took_s), batteries=None)
        return SimpleNamespace(execution=execution)

    monkeypatch.setattr(study, "carry_out", driven)
    pilot = Study(Question(read_scenario(tmp_path / "charging.yaml"), (1, 2), QUICK, 60.0)).pilot
    assert (pilot.robots, pilot.slower) == (2, pytest.approx(2.0))
