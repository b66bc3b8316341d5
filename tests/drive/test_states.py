"""Orders, robots and runs change their states by the rules of the scenario: each rule decides one way here, and the other beside it.

A Burger drives a cell of 0.4 m in 1.82 s; services take 5 s unless said otherwise.
"""

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from floors import BATTERY, driven, ring, scenario
from worlds import BURGER, drive, graph_of, line, problem_on, square_grid

from mrp_sumo.core.disturbances import Breakdown, Disturbances
from mrp_sumo.core.execution import Outcome
from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.order_rules import Cancel, Retry
from mrp_sumo.core.robot_states import ROBOT_STATES
from mrp_sumo.core.robot_type import Battery
from mrp_sumo.core.stream import TaskList
from mrp_sumo.core.task import NOBODY, Station, Stop, Task
from mrp_sumo.drive import rolling
from mrp_sumo.drive.crew import Crew
from mrp_sumo.drive.ledger import Ledger
from mrp_sumo.drive.orders import NEXT, Orders
from mrp_sumo.drive.replanning import planned
from mrp_sumo.drive.robot_work import Change, Condition, Duty, RobotWork, StopRow
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.drive.work_request import still_fits
from mrp_sumo.errors import PlanError
from mrp_sumo.metrics.audit import audit
from mrp_sumo.traffic.resources import resources_of

SMALL = Battery(10.0, 1.0, 36.0, 1.0, 0.0, 0.0, 36.0)  # a thousandth of it goes in a second
WITH_BATTERY = replace(BURGER, battery=SMALL)


def order(name, *route, release_s=0.0, service_s=5.0, **other):
    stops = tuple(Stop(v, service_s, "", Station(f"at {v}", (v,))) for v in route)
    return Task(0, stops, release_s, name=name, **other)


def work(tmp_path, graph, starts, *tasks, broken=(), **settings):
    """Robots that stand at their starts and are given tasks; some break down: (robot, s, for s)."""
    disturbances = Disturbances(breakdowns=tuple(Breakdown(*each) for each in broken))
    usual = {"planner": "lacam", "engine": "kinematic", "time_limit_s": 200.0, "dispatcher": "nearest", "disturbances": disturbances}
    settings = usual | settings
    run = drive(tmp_path, graph, [[v] for v in starts], tasks=(TaskList(tasks),), **settings)
    assert audit(run, fleet_of(BURGER, len(starts)))["passed"]
    log = run.robot_states
    for r in range(len(starts)):  # without gaps from 0 to the end
        mine = log.robot == r
        assert log.begin_s[mine][0] == 0 and log.end_s[mine][-1] == run.sim_time_s
        assert (log.begin_s[mine][1:] == log.end_s[mine][:-1]).all()
    return run


def states(run, robot):
    """What a robot was at, in words."""
    return [ROBOT_STATES[k] for k in run.robot_states.state[run.robot_states.robot == robot].tolist()]


def events(run, kind):
    return [event for event in run.events if event.kind == kind]


def test_an_order_fails_whose_robot_breaks_down_with_it_on_board(tmp_path):
    run = work(tmp_path, square_grid(3), [1, 7], order("a", 0, 8), broken=[(0, 12.0)])
    assert run.tasks.status == ("failed",) and run.tasks.reason == ("robot_0 broke down with it on board",)
    assert run.tasks.ended_s[0] == pytest.approx(12.0, abs=0.1) and np.isnan(run.tasks.done_s[0])
    (failed,) = events(run, "failed")
    assert failed.robot == 0 and failed.text == "order 'a': robot_0 broke down with it on board"
    assert states(run, 0) == ["working", "broken"]


def test_before_its_first_stop_it_goes_to_another_robot(tmp_path):
    run = work(tmp_path, square_grid(3), [1, 7], order("a", 0, 8), broken=[(0, 1.0)])
    assert run.tasks.status == ("done",) and run.tasks.robot.tolist() == [1] and not events(run, "failed")


def test_a_robot_that_is_mended_goes_on_with_its_order(tmp_path):
    run = work(tmp_path, line(5), [0], order("a", 2, 4), broken=[(0, 5.0, 20.0)])
    free = work(tmp_path / "free", line(5), [0], order("a", 2, 4))
    assert run.tasks.status == ("done",) and run.outcome is Outcome.COMPLETED
    assert run.tasks.done_s[0] == pytest.approx(free.tasks.done_s[0] + 20.0, abs=1.0)
    assert states(run, 0)[:3] == ["working", "broken", "working"]


def test_a_robot_that_rolls_to_its_stop_as_it_breaks_down_is_served_once_it_is_mended(tmp_path):
    free = work(tmp_path / "free", line(5), [0], order("a", 2, 4))
    breaks_s = free.stops.begin_s[0] - 0.1
    run = work(tmp_path, line(5), [0], order("a", 2, 4), broken=[(0, breaks_s, 20.0)])
    assert run.stops.begin_s[0] == pytest.approx(breaks_s + 20.0, abs=0.5) and run.tasks.status == ("done",)


@pytest.mark.parametrize(("left_m", "stops"), [(0.0, [0]), (0.9, [])])
def test_a_robot_that_waits_on_the_lane_behind_a_vertex_makes_no_stop_there(left_m, stops):
    visits = SimpleNamespace(reached=np.array([0]), granted=np.array([0]), next=np.array([1, -1]), at_m=np.zeros(2))
    state = SimpleNamespace(motion=SimpleNamespace(s_m=np.array([left_m])))
    made = []
    crew = SimpleNamespace(
        ledger=SimpleNamespace(visits=visits, state=state),
        seen=np.array([0]),
        _comes_to=lambda robot, visit: True,
        _begin_stop=lambda robot, visit, now_s: made.append(visit) or np.inf,
    )
    Crew.follow(crew, SimpleNamespace(is_down=False, making=None, number=0, legs=[None]), 0.0)
    assert made == stops


def test_an_order_is_begun_anew_as_often_as_the_rule_says(tmp_path):
    once = work(tmp_path, square_grid(3), [1, 7], order("a", 0, 8), broken=[(0, 12.0)], retry=Retry(times=1))
    assert once.tasks.status == ("done",) and once.tasks.robot.tolist() == [1] and len(events(once, "begun_anew")) == 1
    assert once.tasks.opened_s[0] > 12.0  # the load is picked up again, where it was
    assert [name for name, r in zip(once.stops.station, once.stops.robot.tolist()) if r == 1] == ["at 0", "at 8"]
    again_s = once.tasks.opened_s[0] + 6.0
    twice = work(tmp_path / "2", square_grid(3), [1, 7], order("a", 0, 8), broken=[(0, 12.0), (1, again_s)], retry=Retry(times=1))
    assert twice.tasks.status == ("failed",) and twice.tasks.reason == ("robot_1 broke down with it on board",)


def test_a_load_is_handed_over_beside_the_robot_that_is_lost(tmp_path):
    run = work(tmp_path, square_grid(3), [1, 7], order("a", 0, 8), broken=[(0, 12.0)], retry=Retry(hand_over=True))
    assert run.tasks.status == ("done",) and run.tasks.robot.tolist() == [1] and len(events(run, "handed_over")) == 1
    made = [name for name, r in zip(run.stops.station, run.stops.robot.tolist()) if r == 1]
    assert made == ["beside robot_0", "at 8"] and run.tasks.opened_s[0] < 12.0
    lost_xy, place = np.array([run.x_m[-1, 0], run.y_m[-1, 0]]), int(run.stops.vertex[list(run.stops.station).index("beside robot_0")])
    assert 0.3 < np.hypot(*(square_grid(3).xy[place] - lost_xy)) < 1.0


def test_nobody_is_left_to_fetch_a_load(tmp_path):
    run = work(tmp_path, square_grid(3), [1], order("a", 0, 8), broken=[(0, 12.0)], retry=Retry(hand_over=True))
    assert run.tasks.status == ("handed over",) and np.isnan(run.tasks.assigned_s[0]) and run.outcome is Outcome.STALLED


@pytest.mark.parametrize("after_s, status", [(20.0, "cancelled"), (100.0, "done")])
def test_orders_are_withdrawn_that_nobody_has_picked_up_in_time(tmp_path, after_s, status):
    # the only robot is served for 60 s
    tasks = order("long", 2, service_s=60.0), order("waits", 4)
    run = work(tmp_path, line(5), [0], *tasks, cancel=Cancel(after_s=after_s))
    assert run.tasks.status == ("done", status) and run.outcome is Outcome.COMPLETED
    if status == "cancelled":
        assert run.tasks.ended_s[1] == 20.0 and run.tasks.reason[1] == "not picked up by 20 s"
        assert [event.t_s for event in events(run, "cancelled")] == [20.0]
        assert 4 not in run.stops.vertex.tolist()


@pytest.mark.parametrize("due_s, status", [(30.0, "cancelled"), (90.0, "done")])
def test_orders_are_withdrawn_when_they_are_due(tmp_path, due_s, status):
    tasks = order("long", 2, service_s=60.0), order("waits", 4, due_s=due_s)
    run = work(tmp_path, line(5), [0], *tasks, cancel=Cancel(overdue=True))
    assert run.tasks.status == ("done", status)
    rest = work(tmp_path / "kept", line(5), [0], *tasks)
    assert rest.tasks.status == ("done", "done")


def test_a_robot_on_its_way_is_freed_when_its_order_is_withdrawn(tmp_path):
    run = work(tmp_path, line(12), [0], order("far", 11), order("near", 10, release_s=10.0), cancel=Cancel(after_s=15.0))
    assert run.tasks.status == ("cancelled", "done") and run.tasks.ended_s[0] == 15.0
    assert states(run, 0)[0] == "working" and run.tasks.assigned_s[1] == pytest.approx(15.0, abs=0.11)


def test_an_order_fails_whose_robot_runs_empty_with_it_on_board(tmp_path):
    # 2 cells and a service of 5 s take less than the 12 s that are left; 6 more cells do not
    run = work(tmp_path, line(12), [0], order("a", 2, 11), robot=WITH_BATTERY, start_level=(0.012, 0.012))
    assert run.tasks.status == ("failed",) and run.tasks.reason == ("robot_0 ran empty with it on board",)
    assert states(run, 0) == ["working", "empty"]
    fuller = work(tmp_path / "more", line(12), [0], order("a", 2, 11), robot=WITH_BATTERY, start_level=(0.06, 0.06))
    assert fuller.tasks.status == ("done",)


@pytest.mark.parametrize("robot_type, status", [("forklift", "failed"), (BURGER.name, "done")])
def test_an_order_fails_that_no_robot_can_do(tmp_path, robot_type, status):
    run = work(tmp_path, line(5), [0], order("a", 2), order("b", 3, robot_type=robot_type, release_s=4.0))
    assert run.tasks.status == ("done", status) and run.outcome is Outcome.COMPLETED
    assert run.tasks.reason[1] == ("no robot that can do it is left" if status == "failed" else "")


@pytest.mark.parametrize("robot, status", [(0, "failed"), (1, "done"), (NOBODY, "done")])
def test_an_order_fails_whose_only_robot_is_lost(tmp_path, robot, status):
    run = work(tmp_path, square_grid(3), [1, 7], order("a", 8, release_s=20.0, robot=robot), broken=[(0, 10.0)])
    assert run.tasks.status == (status,) and run.tasks.reason == ("no robot that can do it is left" if status == "failed" else "",)


def test_an_order_fails_at_whose_only_place_a_lost_robot_stands(tmp_path):
    # robot_0 breaks down while it leaves vertex 0, where the order is to be begun anew; at 12 s it is clear of it
    run = work(tmp_path, square_grid(3), [1, 7], order("a", 0, 8), broken=[(0, 10.0)], retry=Retry(times=1))
    assert run.tasks.status == ("failed",) and run.tasks.reason == ("a robot that is lost stands where its next stop is",)
    assert states(run, 1)[-1] == "idle" and run.outcome is Outcome.COMPLETED


def test_who_stands_behind_a_robot_that_is_lost_is_stalled_and_so_is_the_run(tmp_path):
    tasks = order("a", 7), order("b", 6)
    run = work(tmp_path, line(8), [2, 0], *tasks, broken=[(0, 1.0)])
    assert run.outcome is Outcome.STALLED and set(run.tasks.status) <= {"assigned", "released"}
    assert "stalled" in states(run, 1) and states(run, 0)[-1] == "broken"
    (stalled,) = events(run, "stalled")
    assert stalled.robot == 1 and stalled.t_s == pytest.approx(60.0 + 2.0, abs=3.0)
    mended = work(tmp_path / "mended", line(8), [2, 0], *tasks, broken=[(0, 1.0, 30.0)])
    assert mended.outcome is Outcome.COMPLETED and not events(mended, "stalled")


@pytest.mark.parametrize(("broken_s", "status"), [(3.0, "done"), (5.0, "assigned")])
def test_a_robot_that_is_lost_gives_back_what_it_was_granted_ahead_of_it(tmp_path, broken_s, status):
    """It was on its way from 0 over the crossing 3 to 7, and stops 0.5 or 0.1 m before it for good; another has to cross there."""
    row = [(0.4 * k, 0.0) for k in range(8)]
    lanes = [*pairwise(range(8)), (3, 8), (8, 9), (3, 10), (10, 11)]
    graph = graph_of([*row, (1.2, 0.4), (1.2, 0.8), (1.2, -0.4), (1.2, -0.8)], lanes, 0.4)
    tasks = order("a", 7, robot=0), order("b", 11, robot=1, release_s=20.0)
    run = work(tmp_path, graph, [0, 9], *tasks, broken=[(0, broken_s)])
    assert run.tasks.status == ("failed", status)


def test_a_robot_that_is_stalled_for_good_makes_a_run_stalled_though_others_work(tmp_path):
    # robot_1 is shut in behind robot_0, which is lost; robot_2 is served on the other side
    tasks = order("long", 8, service_s=600.0), order("shut in", 4, release_s=5.0)
    run = work(tmp_path, line(10), [2, 0, 9], *tasks, broken=[(0, 1.0)], time_limit_s=520.0)
    assert run.outcome is Outcome.STALLED and run.tasks.robot.tolist() == [2, 1]
    short = work(tmp_path / "short", line(10), [2, 0, 9], *tasks, broken=[(0, 1.0)], time_limit_s=200.0)
    assert short.outcome is Outcome.TIME_LIMIT


@pytest.mark.parametrize(("limit_s", "outcome"), [(435.0, Outcome.STALLED), (365.0, Outcome.TIME_LIMIT)])
def test_a_run_is_stalled_where_robots_can_make_no_stop(tmp_path, limit_s, outcome):
    """Each is on the wrong side of the other: the last service ends at 8 s, and three times seven steps of 3 s are enough for any way.

    The one that has had its stop for longer drives the other to the end of the line, where it stands from 15 s on.
    """
    run = work(tmp_path, line(8), [2, 5], order("a", 3, 7), order("b", 4, 0), time_limit_s=limit_s)
    assert run.outcome is outcome and run.tasks.status == ("picked", "picked")
    texts = ["has not got on with order 'b' for 60 s", "no stop has been made since 8 s, and 2 orders are open"]
    assert [event.text for event in events(run, "stalled")] == texts[: 1 + (limit_s > 431)]


@pytest.mark.parametrize(("refusals", "outcome", "status"), [(999, Outcome.PLANNER_STALLED, "released"), (3, Outcome.COMPLETED, "done")])
def test_a_run_whose_planner_refuses_again_and_again_is_stalled_by_it(tmp_path, monkeypatch, refusals, outcome, status):
    """Also that which stands in for it does: two refusals a request from the second one on, and a request every two seconds."""
    refused = []

    def refuses(*args):
        if len(refused) < refusals:
            refused.append(args[0].now_s)
            raise PlanError("no plan today")
        return planned(*args)

    monkeypatch.setattr(rolling, "planned", refuses)
    run = work(tmp_path, line(6), [0], order("a", 3), time_limit_s=100.0)
    assert run.outcome is outcome and run.tasks.status == (status,)
    (no_plan,) = events(run, "no_plan")
    requests = sorted(set(refused))
    assert no_plan.t_s == requests[0] == 0.0 and no_plan.text == f"{len(requests)} requests in a row without a plan"
    assert run.calls.failed == len(requests) and len(refused) == 2 * len(requests) - 1


def test_who_waits_for_a_place_is_not_stalled(tmp_path):
    run = work(tmp_path, line(6), [2, 0], order("a", 4, service_s=150.0), order("b", 4), time_limit_s=300.0)
    assert run.outcome is Outcome.COMPLETED and not events(run, "stalled")


def test_a_service_that_is_over_when_its_robot_breaks_down_is_not_prolonged(tmp_path):
    settings = {"execution": {"step_length_s": 0.5, "planning": {"budget_s": 0.0}, "time_limit_s": 60.0}, "record": {"period_s": 0.5}}
    settings["execution"]["disturbances"] = {"breakdowns": [{"robot": 0, "begin_s": 7.3, "duration_s": 20.0}]}  # seen at 7.5 s
    orders = [{"name": f"o{k}", "stops": ["A"], "service_s": service_s} for k, service_s in enumerate((7.4, 5.0))]
    result = driven(scenario(ring(tmp_path), {"list": orders}, starts=["A"], **settings))
    assert result.execution.tasks.done_s[0] == pytest.approx(7.4) and result.operations_audit["passed"]


def test_a_robot_that_breaks_down_at_a_charger_is_not_charged_meanwhile(tmp_path):
    charging = {"stations": ["A"], "critical_low_charging_level": 50.0, "start_level": [20.0, 20.0], "maximum_desired_charging_level": 90.0}
    settings = {"execution": {"time_limit_s": 90.0, "disturbances": {"breakdowns": [{"robot": 0, "begin_s": 10.3, "duration_s": 30.0}]}}}
    tasks = {"list": [{"name": "o", "stops": ["B"]}], "charging": charging}
    result = driven(scenario(ring(tmp_path), tasks, starts=["A"], shape={"battery": BATTERY}, **settings))
    log = result.execution.batteries
    level = dict(zip(log.t_s.tolist(), log.level[:, 0].tolist()))
    broken = result.execution.robot_states.state == ROBOT_STATES.index("broken")
    assert result.execution.robot_states.end_s[broken] == pytest.approx(40.3)  # whenever it is looked at next
    assert level[10.0] > level[0.0] + 0.1 and level[10.0] > level[30.0] > level[10.0] - 0.02 and level[50.0] > level[30.0] + 0.1
    assert result.operations_audit["passed"], result.note


@pytest.mark.parametrize(("asked_s", "fits"), [(9.0, False), (10.5, True)])
def test_who_has_begun_a_short_service_since_it_was_sent_away_stays(asked_s, fits):
    """Leaving at once, since it will be over when the next answer takes effect."""
    problem = problem_on(line(3), [1], [1])
    crew = Crew(Ledger(problem, resources_of(problem.graph, problem.fleet.apart_m)), ExecutionSettings())
    robot = crew.robots[0]
    robot.making, robot.leaves = StopRow(0, 0, "", 1, 0.0, 10.0, 12.0, 0.0, 0.0, np.nan), True
    assert still_fits(crew, SimpleNamespace(now_s=asked_s, robot=np.array([0])), {0}) is fits


def test_states_change_by_the_table_alone():
    stop = (Stop(0, 1.0),)
    for first, then in (("assigned", "done"), ("done", "failed"), ("cancelled", "assigned"), ("released", "picked")):
        assert then not in NEXT[first]
    orders = Orders([TaskList((Task(0, stop),))])
    orders.reveal(0.0)
    with pytest.raises(AssertionError, match="released -> done"):
        orders.finish(0, 1.0)


def test_the_documented_transitions_are_those_of_the_code():
    lines = (Path(__file__).resolve().parents[2] / "docs" / "lifelong.md").read_text().splitlines()
    rows = {cells[0].strip(): cells[-1] for line in lines if line.startswith("| `") and (cells := line.strip("| ").split("|"))}
    for name, then in NEXT.items():
        assert not then or re.findall("`([^`]+)`", rows[f"`{name}`"]) == list(then), name


def test_a_robot_changes_by_the_table_alone():
    robot = RobotWork(0)
    for change in (Change.SERVED, Change.FREED, Change.LINED_UP, Change.MENDED, Change.GETS_ON):
        with pytest.raises(AssertionError, match=change.name):
            robot.on(change, 0.0)
    assert (robot.duty, robot.condition) == (Duty.IDLE, Condition.SOUND)


@pytest.mark.parametrize(("befalls", "over"), [(Change.BREAKS, Change.MENDED), (Change.STALLS, Change.GETS_ON)])
def test_a_robot_that_waits_in_line_does_so_still_when_what_befell_it_is_over(befalls, over):
    robot = RobotWork(0)
    robot.begin([(3, 0)], 0.0, 0.0, (0.0, 0.0), charges=False)
    for change in (Change.LINED_UP, befalls, over):
        robot.on(change, 1.0)
    assert (robot.duty, robot.condition) == (Duty.WAITING, Condition.SOUND)


def test_a_service_shows_that_a_robot_is_not_stalled_and_who_is_broken_ends_none():
    robot = RobotWork(0)
    robot.begin([(3, 0)], 0.0, 0.0, (0.0, 0.0), charges=False)
    robot.on(Change.STALLS, 1.0)
    robot.on(Change.SERVED, 2.0)
    assert (robot.duty, robot.condition) == (Duty.IN_SERVICE, Condition.SOUND)
    robot.on(Change.BREAKS, 3.0)
    with pytest.raises(AssertionError, match="FREED: broken"):
        robot.on(Change.FREED, 4.0)


def test_who_breaks_down_for_good_while_it_is_broken_is_lost_with_its_order(tmp_path):
    run = work(tmp_path, square_grid(3), [1, 7], order("a", 0, 8), broken=[(0, 12.0, 50.0), (0, 20.0)])
    assert run.tasks.status == ("failed",) and run.tasks.ended_s[0] == pytest.approx(20.0, abs=0.1)
    assert run.outcome is Outcome.COMPLETED and states(run, 0) == ["working", "broken", "broken"]  # with it, and without


def test_a_robot_is_idle_from_when_its_order_is_withdrawn_though_that_is_between_two_steps(tmp_path):
    run = work(tmp_path, line(9), [0], order("far", 8), cancel=Cancel(after_s=3.333))
    idle = run.robot_states.state == ROBOT_STATES.index("idle")
    assert run.tasks.status == ("cancelled",) and run.robot_states.begin_s[idle].tolist() == [3.333] == run.tasks.ended_s.tolist()
