"""The planner is asked on simulated time: the same plans however fast the machine is, from where robots are committed to be."""

import sys
import time
from dataclasses import dataclass, replace

import numpy as np
import pytest
from worlds import BURGER, POINT, drive, ending_there, line, problem_of, problem_on, square_grid

from mrp_sumo.core.arrivals import Arrivals, ServiceTime
from mrp_sumo.core.disturbances import Breakdown, Disturbances
from mrp_sumo.core.driving import Planning
from mrp_sumo.core.execution import BOOKINGS, Outcome
from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.stream import TaskList, TaskStream
from mrp_sumo.core.task import Station, Stop, Task
from mrp_sumo.drive import ledger as ledger_module
from mrp_sumo.drive import loop, replanning
from mrp_sumo.drive.fit import resources_for
from mrp_sumo.drive.ledger import Ledger
from mrp_sumo.drive.listeners import Listener
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.policy import policy_of
from mrp_sumo.drive.reroute import first_of
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.drive.state import Kinematics
from mrp_sumo.errors import ExecutionError, PlanningOverrun
from mrp_sumo.planning import registry
from mrp_sumo.planning.registry import planner as planner_of
from mrp_sumo.traffic.referee import judge
from planners.configuration.pibt import Pibt

REPLY_COLUMNS = ("robot", "first", "since", "vertex", "arrive_s", "depart_s", "arrived_s")
ROUTES = tuple(tuple(Station(f"at {v}", (v,)) for v in route) for route in [(0, 24), (4, 20), (20, 4), (24, 0), (2, 22)])
STREAM = TaskStream("order", Arrivals(open=6), ROUTES, np.ones(5), (ServiceTime(constant_s=2.0),))
STARTS = [1, 6, 12, 18, 23]


def carry(tmp_path, **settings):
    """Five robots on a grid of 25 with six orders open at any time, from corner to corner."""
    planning = Planning(budget_s=1.0, effort=20_000)
    usual = {"planning": planning, "engine": "kinematic", "time_limit_s": 40.0, "dispatcher": "nearest", "tasks": (STREAM,)}
    return drive(tmp_path, square_grid(5), [[v] for v in STARTS], **usual | settings)


def slowed(monkeypatch, times):
    """All that reads the clock for limits sees it go so many times as fast."""
    real = time.process_time
    for module in list(sys.modules.values()):
        if getattr(module, "process_time", None) is real and module is not time:
            monkeypatch.setattr(module, "process_time", lambda: times * real())


@pytest.mark.parametrize(
    ("planner", "parameters"),
    [
        ("lns2", {"anytime": True}),
        ("lacam", {"anytime": True}),
        ("prioritised", {}),
        ("eecbs", {}),
        pytest.param("continuous", {"anytime": True}, marks=pytest.mark.slow),
    ],
)
def test_plans_do_not_depend_on_the_speed_of_the_machine(tmp_path, monkeypatch, planner, parameters):
    planner_of(planner, parameters).prepare()
    runs = []
    for times in (1, 25):
        with monkeypatch.context() as clock:
            slowed(clock, times)
            runs.append(carry(tmp_path, planner=planner, planner_parameters=parameters))
    one, other = runs
    assert one.tasks.done_s.tobytes() == other.tasks.done_s.tobytes() and one.x_m.tobytes() == other.x_m.tobytes()
    assert one.calls.requests > 4 and replace(one.calls, wall_time_s=0.0, cpu_time_s=0.0) == replace(
        other.calls, wall_time_s=0.0, cpu_time_s=0.0
    )


@dataclass(frozen=True)
class Fails:
    """Finds nothing, or what it is said to find."""

    assigns = False
    guarantee = "none"
    status: str = "gave_up"

    def prepare(self):
        pass

    def plan(self, problem, time_limit_s):
        return PlanResult(Status(self.status), message="as it is made")


def test_where_the_planner_fails_twice_running_robots_are_moved_step_by_step(tmp_path, monkeypatch):
    make = registry.planner
    monkeypatch.setattr(registry, "planner", lambda name, parameters: Fails(**parameters) if name == "fails" else make(name, parameters))
    for status, counted in (("gave_up", "failed"), ("timed_out", "late")):
        run = carry(tmp_path, planner="fails", planner_parameters={"status": status}, time_limit_s=80.0)
        calls = run.calls
        assert getattr(calls, counted) > calls.stepped > 0 and calls.stopped == 0 and run.tasks.status.count("done") > 0


@pytest.mark.parametrize("planner", ["fails", "lacam"])
def test_a_request_is_counted_once_though_what_pibt_answers_cannot_be_driven_either(tmp_path, monkeypatch, planner):
    make = registry.planner
    monkeypatch.setattr(registry, "planner", lambda name, parameters: Fails("timed_out") if name == "fails" else make(name, parameters))
    monkeypatch.setattr(loop.Drive, "_append", lambda *params: False)
    calls = carry(tmp_path, planner=planner, time_limit_s=20.0).calls
    counts = (calls.requests, 0) if planner == "fails" else (0, calls.requests)
    assert (calls.late, calls.failed) == counts and calls.requests > 3


def test_a_planner_that_takes_far_too_long_ends_the_run(tmp_path, monkeypatch):
    monkeypatch.setattr(replanning, "GUARD_S", 1e-9)
    with pytest.raises(PlanningOverrun, match=r"planner 'prioritised' worked for more than 1e-09 s on the plan from 1 s on"):
        carry(tmp_path, planner="prioritised")


def test_what_is_frozen_includes_that_those_who_pass_before_have_left():
    # robot_0 is to pass vertex 4, the middle, before robot_1
    problem, plan = problem_of(square_grid(3), [[3, 4, 5, 8], [1, 1, 1, 4, 7]], BURGER)
    ledger = Ledger(problem, resources_for(problem, plan))
    ledger.append(first_of(plan), policy_of("adg"), 0.0)
    limits = np.full(2, 0.5)
    kinematics = Kinematics(limits, limits, limits, 0.1 * limits, 0.1 * limits, 0.1 * limits, 0 * limits)
    nobody, closed = np.zeros(2, np.bool_), np.zeros(ledger.graph.num_lanes, np.bool_)
    ledger.cut(0.0, kinematics, closed, nobody)
    assert ledger.visits.vertex[ledger.joint].tolist() == [4, 1]  # 0.3 m to brake; who goes first is still at the middle
    ledger.lift()
    ledger.cut(0.5, kinematics, closed, nobody)
    assert ledger.visits.vertex[ledger.joint].tolist() == [5, 7]
    ledger.lift()
    ledger.cut(0.5, kinematics, closed, np.array([True, False]))  # robot_0 stays where it is
    assert ledger.visits.vertex[ledger.joint].tolist() == [3, 1]
    assert ledger.state.yielding.pause.tolist() == [0, 0]


@pytest.mark.parametrize("planner", ["prioritised", "lns2", "pibt", "ecbs", "pbs"])
def test_robots_that_cannot_pass_each_other_are_planned_for_a_window(planner):
    problem = replace(problem_on(line(9), [0, 8], [8, 0]), window_steps=3, drivable=True)
    result = planner_of(planner, {}).plan(problem, 60.0)
    assert result.status is Status.SOLVED
    assert result.plan.arrive_s.max() <= 3 * problem.step_s and judge(ending_there(problem, result.plan), result.plan).valid


@pytest.mark.parametrize("planner", ["prioritised", "lns2", "lacam", "pibt", "ecbs", "pbs"])
def test_nobody_collides_within_a_window(planner):
    rng = np.random.default_rng(1)
    for seed in range(3):
        start, goal = rng.permutation(36)[:14], rng.permutation(36)[:14]
        problem = replace(problem_on(square_grid(6), start, goal, seed), window_steps=4, drivable=True)
        result = planner_of(planner, {}).plan(problem, 60.0)
        assert result.status is Status.SOLVED
        assert result.plan.arrive_s.max() <= 4 * problem.step_s and judge(ending_there(problem, result.plan), result.plan).valid


def test_windows_bring_robots_past_each_other_and_to_their_stops(tmp_path):
    run = carry(tmp_path, planner="prioritised", planning=Planning(budget_s=1.0, window_s=15.0), time_limit_s=120.0)
    assert run.tasks.status.count("done") >= 12 and run.calls.failed + run.calls.late <= 2


@pytest.mark.parametrize("step_s", [0.4, 3.0])
def test_robots_that_are_ahead_of_their_plan_have_another_before_its_end(tmp_path, step_s):
    """With steps of 3 s robots come to the end of a window of 20 cells in 9 s, long before half of its 60 s are over."""
    tasks = TaskList((Task(0, (Stop(69),), name="far"),))
    planning = Planning(budget_s=1.0, window_s=20 * step_s)
    usual = {"planning": planning, "engine": "kinematic", "dispatcher": "nearest", "tasks": (tasks,), "planner": "lacam"}
    run = drive(tmp_path, line(70), [[0]], robot=POINT, step_s=step_s, **usual)
    moved_s = run.booked_s[0, BOOKINGS.index("moving")]
    assert run.calls.requests > 2 and run.tasks.done_s[0] == pytest.approx(moved_s + 1.0, abs=0.3)


def test_robots_go_by_stops_at_which_nothing_is_to_be_done(tmp_path):
    tasks = TaskList((Task(0, tuple(Stop(v) for v in (3, 6, 8)), name="round"),))
    usual = {"planning": Planning(budget_s=1.0), "engine": "kinematic", "dispatcher": "nearest", "tasks": (tasks,)}
    runs = [drive(tmp_path, line(9), [[0]], planner=planner, **usual) for planner in ("pbs", "prioritised")]
    for run in runs:  # the one knows stops ahead, the other is asked for the way on before a robot has to brake
        assert run.stops.vertex.tolist() == [3, 6, 8] and run.stops.task.tolist() == [0, 0, 0]
        moved_s = run.booked_s[0, BOOKINGS.index("moving")]
        assert run.tasks.done_s[0] == pytest.approx(moved_s + 1.0, abs=0.3)  # it moves all the time, once there is an answer
        assert (run.stops.begin_s == run.stops.end_s).all() and (run.stops.since_s[1:] == run.stops.end_s[:-1]).all()


def test_a_robot_that_cannot_reach_a_stop_on_its_way_takes_nobody_elses_way(tmp_path):
    """robot_2 stands at the far end for good, where robot_0 is to turn round; robot_1 has its order all the same."""
    orders = Task(0, (Stop(5), Stop(0)), robot=0, name="there and back"), Task(0, (Stop(3),), robot=1, name="beside")
    disturbances = Disturbances(breakdowns=(Breakdown(2, 0.0),))
    usual = {"planning": Planning(budget_s=1.0), "engine": "kinematic", "dispatcher": "nearest", "time_limit_s": 40.0}
    run = drive(tmp_path, line(6), [[0], [2], [5]], planner="pbs", tasks=(TaskList(orders),), disturbances=disturbances, **usual)
    assert (run.calls.failed, run.calls.late) == (0, 0) and run.tasks.status == ("assigned", "done")


def test_planners_hear_since_when_robots_have_had_their_stops(tmp_path, monkeypatch):
    """robot_0 has an order from the beginning, robot_1 one 5 s later, robot_2 one 10 s later; who is being given one has none yet."""
    heard, plan = [], Pibt.plan
    monkeypatch.setattr(Pibt, "plan", lambda self, problem, limit_s: heard.append(problem.since_s.tolist()) or plan(self, problem, limit_s))
    orders = TaskList(tuple(Task(r, (Stop(9 * r + 8),), release_s=5.0 * r, robot=r, name=str(r)) for r in range(3)))
    usual = {"planning": Planning(budget_s=1.0), "engine": "kinematic", "dispatcher": "nearest", "planner": "pibt"}
    drive(tmp_path, square_grid(9), [[0], [9], [18]], tasks=(orders,), **usual)
    assert heard[0] == [np.inf] * 3 and [0.0, np.inf, np.inf] in heard and [0.0, 5.0, np.inf] in heard


@pytest.mark.parametrize(("num_robots", "period_s"), [(5, 0.0), (12, 0.0), (36, 5.0), (60, 10.0), (500, 10.0)])
def test_the_more_robots_there_are_the_less_often_they_are_planned(num_robots, period_s):
    assert Planning().least_period_s(num_robots, step_s=2.0) == period_s
    assert Planning(period_s=3.0).least_period_s(num_robots, step_s=2.0) == 3.0
    assert Planning(window_s=6.0).least_period_s(num_robots, step_s=2.0) == min(period_s, period_s / 10.0 * 2.0)


def test_a_crowd_makes_more_stops_where_it_is_planned_less_often(tmp_path):
    """36 robots on a grid of 144, each always on its way to somewhere; a step takes 3 s, and a request has its answer a second later."""
    stops = tuple((Station(f"at {v}", (v,)),) for v in range(144))
    stream = TaskStream("order", Arrivals(open=72), stops, np.ones(144), (ServiceTime(constant_s=0.0),))
    starts = [[int(v)] for v in np.random.default_rng(0).choice(144, 36, replace=False)]
    usual = {"engine": "kinematic", "dispatcher": "nearest", "tasks": (stream,), "planner": "prioritised", "time_limit_s": 60.0}
    seldom, often = (
        drive(tmp_path, square_grid(12), starts, planning=Planning(period_s=period_s, effort=50_000), **usual) for period_s in (None, 0.0)
    )
    assert seldom.calls.requests <= 9 and seldom.calls.failed == 0 and often.calls.requests > 30
    assert len(seldom.stops.task) > len(often.stops.task)


def test_a_ledger_that_forgets_drives_and_logs_the_same(tmp_path, monkeypatch):
    runs = []
    for many in (10**6, 20):
        monkeypatch.setattr(ledger_module, "MANY", many)
        num_forgotten, forget = [0], Ledger.forget

        def counted(ledger, needed, count=num_forgotten, forget=forget):
            count.append(1)
            forget(ledger, needed)

        monkeypatch.setattr(Ledger, "forget", counted)
        runs.append(carry(tmp_path, planner="prioritised", planning=Planning(budget_s=1.0, window_s=15.0), time_limit_s=120.0))
        monkeypatch.setattr(Ledger, "forget", forget)
    assert len(num_forgotten) > 3  # in the second run
    one, other = runs
    for name in ("x_m", "y_m", "yaw_rad", "speed_mps", "arrived_s", "booked_s"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
    assert one.events == other.events and one.tasks.done_s.tobytes() == other.tasks.done_s.tobytes()
    for reply, same in zip(one.replies, other.replies, strict=True):
        assert all(
            np.array_equal(vars(reply)[name], vars(same)[name], equal_nan=vars(reply)[name].dtype.kind == "f") for name in REPLY_COLUMNS
        )


@dataclass
class EndedAt30(Listener):
    now_s: float = 0.0
    is_patient = True

    def hear(self, time_s):
        self.now_s = time_s.now_s

    def wants_end(self):
        return self.now_s >= 30.0


def test_a_run_that_its_user_stops_ends_with_what_there_is(tmp_path):
    problem, plan = problem_of(square_grid(5), [[v] for v in STARTS], BURGER)
    settings = ExecutionSettings(engine="kinematic", dispatcher="nearest", tasks=(STREAM,), time_limit_s=1000.0, planner="prioritised")
    run = simulate(problem, plan, settings, tmp_path / "none.net.xml", listeners=[EndedAt30()])
    assert run.outcome is Outcome.INTERRUPTED and 30.0 <= run.sim_time_s <= 40.0
    assert len(run.t_s) == round(run.sim_time_s * 10) + 1 and "picked" in run.tasks.status


def test_a_window_shorter_than_what_passes_until_there_is_another_is_refused():
    with pytest.raises(ExecutionError, match=r"planning\.window_s is 2, expected more than 4"):
        ExecutionSettings(planning=Planning(budget_s=2.0, window_s=2.0))
