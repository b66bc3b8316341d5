"""Tasks are driven to the end, stop by stop; times and who had what are those of the run, by hand where robots drive alone."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from worlds import BURGER, drive, line, square_grid

from mrp_sumo.core.arrivals import Arrivals, ServiceTime
from mrp_sumo.core.battery import Charging
from mrp_sumo.core.driving import Planning
from mrp_sumo.core.execution import Outcome
from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.robot_type import Battery
from mrp_sumo.core.stream import ClosedLoop, TaskList, TaskStream
from mrp_sumo.core.task import Station, Stop, Task
from mrp_sumo.drive.robot_work import Leg, RobotWork
from mrp_sumo.drive.work_request import take_over
from mrp_sumo.metrics.audit import audit

CELL_S = 0.4 / 0.22


def orders(routes, arrivals=None, service_s=5.0, **other):
    return TaskStream(
        "order",
        arrivals or Arrivals(at_once=True),
        tuple(tuple(Station(f"at {v}", (v,)) if isinstance(v, int) else v for v in route) for route in routes),
        np.ones(len(routes)),
        (ServiceTime(constant_s=service_s),),
        **other,
    )


def work(tmp_path, graph, starts, *streams, **settings):
    """Robots that stand at their starts and are given tasks."""
    settings = {"planner": "lacam", "time_limit_s": 300.0, "dispatcher": "nearest", "tasks": streams, **settings}
    run = drive(tmp_path, graph, [[v] for v in starts], **settings)
    assert audit(run, fleet_of(BURGER, len(starts)))["passed"]
    return run


def test_one_robot_makes_the_stops_of_a_task_one_after_the_other(tmp_path):
    run = work(tmp_path, line(5), [0], orders([(2, 4)], count=1))
    (robot,), (assigned_s,), (opened_s,), (done_s,) = run.tasks.robot, run.tasks.assigned_s, run.tasks.opened_s, run.tasks.done_s
    assert run.outcome is Outcome.COMPLETED and run.tasks.status == ("done",) and robot == 0 and assigned_s == 0
    assert opened_s == pytest.approx(2 * CELL_S, abs=0.3)
    assert done_s == pytest.approx(opened_s + 5 + 2 * CELL_S + 5, abs=1.0)  # the second service included
    assert run.x_m[-1, 0] == pytest.approx(1.6, abs=0.01)


def test_a_robot_stays_for_the_service_time(tmp_path):
    run = work(tmp_path, line(5), [0], orders([(2, 4)], count=1, service_s=12.0))
    there = np.abs(run.x_m[:, 0] - 0.8) < 0.01
    assert there.sum() * 0.1 == pytest.approx(12.0, abs=1.0)


def test_a_task_goes_to_the_nearest_free_robot(tmp_path):
    run = work(tmp_path, line(7), [0, 6], orders([(4,)], count=1))
    assert run.tasks.robot.tolist() == [1]


def test_a_robot_in_the_way_makes_room(tmp_path):
    # robot_1 stands without work where robot_0 has to go
    run = work(tmp_path, square_grid(3), [0, 8], orders([(0, 4)], count=1, service_s=3.0), orders([(8, 0)], count=1, number=1))
    assert run.outcome is Outcome.COMPLETED and set(run.tasks.status) == {"done"}


def test_orders_are_the_same_for_any_fleet(tmp_path):
    stream = orders([(0, 8), (2, 6), (6, 0)], Arrivals(rate_per_h=300), count=6)
    one, three = (work(tmp_path, square_grid(3), starts, stream, time_limit_s=400.0) for starts in ([4], [1, 3, 7]))
    assert one.tasks.name == three.tasks.name
    assert one.tasks.released_s.tolist() == three.tasks.released_s.tolist()
    assert np.nanmean(three.tasks.lead_time_s) < np.nanmean(one.tasks.lead_time_s)


def test_closed_loop_keeps_so_many_open_until_the_time_is_over(tmp_path):
    stream = orders([(0, 8), (2, 6), (6, 0), (8, 2)], Arrivals(open=3), service_s=2.0)
    run = work(tmp_path, square_grid(3), [1, 4], stream, time_limit_s=120.0)
    assert run.outcome is Outcome.COMPLETED and run.sim_time_s == pytest.approx(120)
    known = [(run.tasks.released_s <= t).sum() - (run.tasks.done_s <= t).sum() for t in (1.0, 60.0, 119.0)]
    assert known == [3, 3, 3]
    assert run.tasks.status.count("done") >= 6


def test_a_station_serves_as_many_as_it_has_places_and_others_wait_in_its_queue(tmp_path):
    pack = Station("pack", (4,), (3,))
    run = work(tmp_path, line(6), [0, 2], orders([(pack,)], count=2, service_s=8.0))
    assert set(run.tasks.status) == {"done"}
    first, second = sorted(zip(run.tasks.opened_s.tolist(), run.tasks.done_s.tolist()))
    assert second[0] >= first[1]  # one place: one after the other


def test_the_planner_takes_its_simulated_time(tmp_path):
    at_once, later = (work(tmp_path, line(5), [0], orders([(4,)], count=1), planning=Planning(budget_s=b)) for b in (0.0, 3.0))
    assert later.tasks.opened_s[0] == pytest.approx(at_once.tasks.opened_s[0] + 3.0, abs=0.15)
    assert later.tasks.assigned_s[0] == 0.0


def test_the_same_run_twice_is_the_same(tmp_path):
    stream = orders([(0, 8), (2, 6), (6, 0), (8, 2)], Arrivals(rate_per_h=400), service_s=2.0)
    one, other = (work(tmp_path, square_grid(3), [1, 4, 7], stream, time_limit_s=90.0, planning=Planning(budget_s=1.0)) for _ in range(2))
    assert one.x_m.tobytes() == other.x_m.tobytes() and one.tasks.done_s.tobytes() == other.tasks.done_s.tobytes()


def test_a_robot_at_work_is_not_sent_away_by_recovery(tmp_path):
    stream = orders([(0, 8), (2, 6), (6, 0), (8, 2)], Arrivals(open=4), service_s=6.0)
    run = work(tmp_path, square_grid(3), [1, 4, 7], stream, time_limit_s=100.0, on_deadlock="resolve", policy="open_loop")
    assert run.tasks.status.count("done") >= 3


def test_the_parts_of_a_cycle_add_up_to_it(tmp_path):
    stream = orders([(0, 8), (2, 6), (6, 0), (8, 2)], Arrivals(rate_per_h=500), service_s=4.0, count=8)
    run = work(tmp_path, square_grid(3), [1, 4, 7], stream, planning=Planning(budget_s=1.0))
    tasks, stops = run.tasks, run.stops
    assert set(tasks.status) == {"done"} and stops.task.tolist() == [k for k in range(8) for _ in range(2)]
    assert (stops.stood_s >= 0).all() and (stops.queued_s >= 0).all()
    assert (stops.stood_s + stops.queued_s <= stops.begin_s - stops.since_s + 1e-9).all()
    for k in range(8):
        mine = stops.task == k
        assert stops.since_s[mine][0] == tasks.assigned_s[k] and stops.begin_s[mine][0] == tasks.opened_s[k]
        spent_s = (stops.end_s - stops.since_s)[mine].sum()
        assert tasks.assigned_s[k] - tasks.released_s[k] + spent_s == pytest.approx(tasks.lead_time_s[k], abs=1e-9)


def test_a_robot_that_waits_for_a_place_is_booked_as_queueing(tmp_path):
    pack = Station("pack", (4,), (3,))
    run = work(tmp_path, line(6), [0, 2], orders([(pack,)], count=2, service_s=30.0))
    queued_s = sorted(run.stops.queued_s.tolist())
    assert queued_s[0] == 0 and 15.0 < queued_s[1] < 30.0


def test_nobody_has_a_goal_of_its_own_where_tasks_come(tmp_path):
    run = work(tmp_path, line(5), [0], orders([(2, 4)], count=1))
    assert np.isnan(run.goal_s).all() and run.calls.requests >= 2 and run.calls.failed == 0


def listed(*tasks):
    """Tasks of one stop each: (vertex, release, service)."""
    stops = [(Stop(v, service_s, "", Station(f"at {v}", (v,))),) for v, _, service_s in tasks]
    return TaskList(tuple(Task(k, stop, release_s, name=f"t{k}") for k, (stop, (_, release_s, _)) in enumerate(zip(stops, tasks))))


@pytest.mark.parametrize("dispatcher", ["hungarian", "regret"])
def test_the_robot_in_between_is_left_for_the_task_that_needs_it(tmp_path, dispatcher):
    # task 0 is nearer to robot_1, too, but then robot_0 would have to go all the way to task 1
    run = work(tmp_path, line(7), [0, 4], listed((3, 0.0, 2.0), (6, 0.0, 2.0)), dispatcher=dispatcher)
    assert run.tasks.robot.tolist() == [0, 1] and set(run.tasks.status) == {"done"}


def test_a_task_waits_for_the_robot_that_is_there_sooner_though_busy(tmp_path):
    # robot_0 is served at 2 for 5 s and then 2 cells away, robot_1 8 cells
    run = work(tmp_path, line(9), [2, 8], listed((2, 0.0, 5.0), (0, 1.0, 1.0)), dispatcher="hungarian")
    assert run.tasks.robot.tolist() == [0, 0] and run.tasks.assigned_s[1] >= 5.0


def test_a_task_is_passed_on_before_its_first_stop(tmp_path):
    # robot_1 is on its way to 4 when a task at 11 comes, which is far from robot_0
    tasks = listed((4, 0.0, 2.0), (11, 0.5, 2.0))
    run = work(tmp_path, line(12), [0, 6], tasks, dispatcher="hungarian")
    assert run.tasks.robot.tolist() == [0, 1] and set(run.tasks.status) == {"done"}
    assert run.tasks.assigned_s[0] >= 0.5  # by robot_0


def test_a_task_that_is_kept_stays_with_its_robot(tmp_path):
    tasks = listed((4, 0.0, 2.0), (7, 0.5, 2.0))
    run = work(tmp_path, line(12), [0, 6], tasks, dispatcher="hungarian", dispatcher_parameters={"reassign": False})
    assert run.tasks.robot.tolist()[0] == 1 and run.tasks.assigned_s[0] == 0.0


@pytest.mark.parametrize(
    "dispatcher", ["nearest", "hungarian", "central", "min_cost_flow", "regret", "round_robin", "token_passing", "tpts", "bundle"]
)
def test_every_dispatcher_does_all_tasks(tmp_path, dispatcher):
    stream = orders([(0, 8), (2, 6), (6, 0), (8, 2)], count=8, service_s=2.0)
    run = work(tmp_path, square_grid(3), [1, 4, 7], stream, dispatcher=dispatcher, planning=Planning(budget_s=1.0))
    assert set(run.tasks.status) == {"done"}


def test_orders_in_a_closed_loop_are_due_after_they_become_known(tmp_path):
    stream = orders([(0, 8), (2, 6), (6, 0), (8, 2)], Arrivals(rate_per_h=1.0), due_after_s=50.0)
    run = work(tmp_path, square_grid(3), [1, 4], ClosedLoop((stream,), 2), time_limit_s=100.0)
    done = run.tasks.done_s[run.stops.task]
    assert (run.stops.due_s == run.tasks.released_s[run.stops.task] + 50.0).all() and np.isfinite(done).any()


SMALL = Battery(10.0, 1.0, 36.0, 1.0, 0.0, 0.0, 36.0)  # a thousandth of it goes in a second; it is charged in 100 s
WITH_BATTERY = replace(BURGER, battery=SMALL)


def charging(at, *, opportunity=False, least_s=0.0, first_percent=0.0):
    rules = Charging(
        stations=("charger",),
        policy="opportunity" if opportunity else "threshold",
        critical_low_charging_level=30,
        minimum_charging_time_s=least_s,
        start_charging=first_percent,
    )
    return {"charging": rules, "chargers": (at,)}


def test_a_robot_with_little_left_charges_before_it_takes_a_task(tmp_path):
    run = work(tmp_path, line(5), [0], listed((2, 0.0, 1.0)), robot=WITH_BATTERY, **charging(4), start_level=(0.25, 0.25))
    tasks = run.tasks
    assert tasks.name == ("t0", "charge_0") and set(tasks.status) == {"done"}
    assert tasks.done_s[1] - tasks.opened_s[1] == pytest.approx(76, abs=2)  # from 24 % at its arrival
    assert tasks.assigned_s[0] >= tasks.done_s[1] and run.stops.station[1] == "charger"
    assert run.batteries.level.min() > 0.2 and run.batteries.level.max() == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(("first_percent", "robots"), [(0, []), (50, [0]), (100, [0, 1])])
def test_a_share_of_the_robots_begins_with_a_charge_though_nobody_has_to(tmp_path, first_percent, robots):
    place = charging(4, first_percent=first_percent)
    run = work(tmp_path, line(9), [1, 7], listed((0, 50.0, 1.0)), robot=WITH_BATTERY, **place, start_level=(0.9, 0.9), time_limit_s=40.0)
    assert run.tasks.robot[[name.startswith("charge") for name in run.tasks.name]].tolist() == robots


def test_a_robot_that_charges_for_want_of_work_is_called_off(tmp_path):
    late = listed((2, 40.0, 1.0))
    rest, called = (
        work(tmp_path, line(5), [0], late, robot=WITH_BATTERY, **charging(4, opportunity=True, least_s=s), start_level=(0.35, 0.35))
        for s in (60.0, 0.0)
    )
    assert called.tasks.name[0] == "charge_0" and called.tasks.assigned_s[1] == pytest.approx(40.5, abs=0.6)
    assert rest.tasks.assigned_s[1] >= rest.tasks.opened_s[0] + 60  # not before its least time at the charger
    made = dict(zip(called.stops.station, called.stops.end_s.tolist()))
    assert made["charger"] == called.tasks.done_s[0] < 41  # the log says when it left, not when it would have


@pytest.mark.parametrize(("num_orders", "num_charge"), [(1, 1), (2, 0)])
def test_nobody_goes_to_charge_that_need_not_while_there_is_an_order_for_each(tmp_path, num_orders, num_charge):
    """Both have 35 % left: a minute of charging and more."""
    orders = listed(*[(2, 0.0, 30.0), (6, 0.0, 30.0)][:num_orders])
    place = charging(4, opportunity=True)
    run = work(tmp_path, line(9), [1, 8], orders, robot=WITH_BATTERY, **place, start_level=(0.35, 0.35), time_limit_s=20.0)
    assert sum(name.startswith("charge") for name in run.tasks.name) == num_charge


@pytest.mark.parametrize(("num_orders", "called_off"), [(1, False), (2, True)])
def test_nobody_is_called_off_a_charger_for_an_order_that_another_is_free_for(tmp_path, num_orders, called_off):
    """robot_0 charges from 2 s on and would until 67 s, robot_1 has nothing to do when one order comes, or two."""
    late = listed(*[(4, 40.0, 1.0), (6, 40.0, 1.0)][:num_orders])
    charger = charging(0, opportunity=True)
    run = work(tmp_path, line(9), [1, 8], late, robot=WITH_BATTERY, **charger, start_level=(0.35, 0.35), time_limit_s=90.0)
    done_s = dict(zip(run.tasks.name, run.tasks.done_s.tolist()))
    assert (done_s["charge_0"] < 45) == called_off and run.tasks.robot[run.tasks.name.index("charge_0")] == 0
    assert set(run.tasks.robot[1 : 1 + num_orders].tolist()) == ({0, 1} if called_off else {1})


def test_a_robot_that_runs_empty_stands_and_others_do_its_task(tmp_path):
    run = work(tmp_path, line(9), [0, 8], listed((3, 0.0, 1.0)), robot=WITH_BATTERY, start_level=(0.004, 0.004), time_limit_s=30.0)
    assert [event.robot for event in run.events if event.kind == "battery_empty"] == [0, 1]
    assert run.outcome is Outcome.TIME_LIMIT and run.tasks.status == ("released",) and (run.speed_mps[-1] == 0).all()
    assert run.x_m[-1, 0] < 1.2 and (run.batteries.level[-1] == 0).all()


def test_robots_without_a_task_go_to_park(tmp_path):
    run = work(
        tmp_path,
        line(7),
        [1],
        orders([(2,)], Arrivals(at_once=True), count=1, service_s=1.0),
        orders([(2,)], Arrivals(rate_per_h=0.001), number=1, service_s=1.0),
        parking=(6,),
        time_limit_s=60.0,
    )
    assert run.x_m[-1, 0] == pytest.approx(2.4, abs=0.01)


@pytest.mark.parametrize(("was_to_stop_at", "earliest_s"), [(5, 70.0), (6, 0.0)])
def test_a_robot_that_was_to_go_on_from_its_stop_is_not_served_there_before_an_answer_ends_its_way(was_to_stop_at, earliest_s):
    """It has stood at vertex 5 since 10 s, on a way that led on; an answer at 70 s has it stop there."""
    robot, leg = RobotWork(0, tour=[(0, 0)], legs=[Leg(0, 0, was_to_stop_at)]), Leg(0, 0, 5)
    visits = SimpleNamespace(vertex=np.array([5]), reached=np.array([0]))
    crew = SimpleNamespace(robots=[robot], ledger=SimpleNamespace(visits=visits), is_changed=False, orders=None, follow=lambda *_: None)
    request = SimpleNamespace(robot=np.array([0]), assigned={}, tours={}, legs={0: [leg]}, waits={})
    take_over(crew, request, 70.0)
    assert robot.legs == [leg] and robot.earliest_s == earliest_s
