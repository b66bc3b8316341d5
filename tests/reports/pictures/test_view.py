"""A run as pictures show it: states, a plan as if driven, furniture apart from walls."""

from dataclasses import replace

import numpy as np
import pytest
from vehicles import TRICYCLE, TUGGER, roads
from worlds import SMALL_CART, record_of_two

from mrp_sumo.core.execution import Event
from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import nav_graph, plan_graph
from mrp_sumo.core.plan import plan_of_paths
from mrp_sumo.core.robot_type import Loaded
from mrp_sumo.core.task import StopLog, log_of_times
from mrp_sumo.io.record import AT_GOAL, BLOCKED, MOVING, WAITING
from mrp_sumo.reports.pictures.view import (
    ABSENT,
    bodies_extent,
    drawbars,
    driven_backward,
    forks_of,
    furniture_and_walls,
    parts_at,
    parts_of,
    plan_as_execution,
    state_names,
    view_states,
)


def test_states_are_those_of_the_run():
    state = view_states(record_of_two().execution)
    assert state[5].tolist() == [MOVING, BLOCKED]
    assert state[15].tolist() == [MOVING, WAITING]
    assert state[25].tolist() == [MOVING, MOVING]
    assert state[-1].tolist() == [AT_GOAL, ABSENT]


@pytest.mark.parametrize(("length_m", "beyond_m"), [(0.4, 0.0), (2.0, 0.5)])
def test_a_view_leaves_room_for_bodies_that_stand_out_beyond_its_margin(length_m, beyond_m):
    record = record_of_two()
    x, y, fleet = record.execution.x_m, record.execution.y_m, record.fleet
    wide = replace(fleet, length_m=np.full(2, length_m), width_m=np.zeros(2))
    expected = [(np.nanmin(x) - beyond_m, np.nanmin(y) - beyond_m), (np.nanmax(x) + beyond_m, np.nanmax(y) + beyond_m)]
    assert bodies_extent(replace(record, fleet=wide), 0.5) == pytest.approx(np.array(expected))


def test_who_has_no_task_or_is_served_does_not_wait():
    execution, none, long_s = record_of_two().execution, np.zeros(0), float(record_of_two().execution.t_s[-1]) + 1
    quiet = replace(execution, speed_mps=np.zeros_like(execution.speed_mps), yaw_rad=np.zeros_like(execution.yaw_rad), events=())
    quiet = replace(quiet, goal_s=np.full(2, np.nan), x_m=np.ones_like(execution.x_m), y_m=np.ones_like(execution.y_m))
    once, robot = np.array([0.5]), np.array([0])
    tasks = log_of_times(("order",), robot, none, once, np.array([1.0]), np.array([long_s]))
    stops = StopLog(robot, robot, ("dock",), robot, once, np.array([1.0]), np.array([1.5]), *(np.zeros(1),) * 3)
    state, t_s = view_states(replace(quiet, tasks=tasks, stops=stops)), execution.t_s
    assert set(state[:, 1].tolist()) == {AT_GOAL}
    assert [int(state[np.searchsorted(t_s, t), 0]) for t in (0.3, 0.7, 1.2, 1.7)] == [AT_GOAL, WAITING, AT_GOAL, WAITING]
    assert (state_names(True)[AT_GOAL], state_names(False)[AT_GOAL]) == ("idle or served", "at goal")


def test_a_broken_robot_is_blocked_whether_it_has_work_or_not_but_not_while_it_is_pushed():
    """From 1.5 s on; robot 0 drives until 3 s, robot 1 from 2 to 3 s, as if pushed; no stop of noise or maintenance counts."""
    record = record_of_two()
    broken = [Event(1.5, "disturbed", r, duration_s=np.inf, text="breaks down") for r in (0, 1)]
    resting = log_of_times((), np.zeros(0, np.int64), *(np.zeros(0),) * 4)
    state = view_states(replace(record.execution, events=tuple(broken), tasks=resting))
    assert state[[14, 16, 25, 35], 1].tolist() == [AT_GOAL, BLOCKED, MOVING, BLOCKED]
    assert state[[25, 35], 0].tolist() == [MOVING, BLOCKED]
    stops = tuple(replace(event, text=text) for event, text in zip(broken, ("", "is maintained")))
    assert BLOCKED not in view_states(replace(record.execution, events=stops, tasks=resting))


def test_a_robot_that_turns_in_place_does_not_wait():
    record = record_of_two()
    yaw = record.execution.yaw_rad.copy()
    yaw[12:16, 1] += 0.1 * np.arange(4)
    state = view_states(replace(record.execution, yaw_rad=yaw))
    assert state[13:16, 1].tolist() == [MOVING] * 3
    assert state[18, 1] == WAITING


def test_plan_alone_is_driven_exactly():
    record = record_of_two()
    execution = plan_as_execution(record.plan, record.graph, record.fleet)
    k = {round(t, 6): i for i, t in enumerate(execution.t_s)}
    assert execution.x_m[k[1.0]].tolist() == pytest.approx([1.5, 0.5])
    assert execution.y_m[k[2.6]].tolist() == pytest.approx([0.5, 2.1])
    assert execution.yaw_rad[k[2.6]].tolist() == pytest.approx([0, np.pi / 2])
    assert execution.goal_s.tolist() == [3, 3]


T_JUNCTION = roads([(0.0, 0.0), (4.0, 0.0), (4.0, -4.0), (8.0, 0.0)], [(0, 1), (1, 2), (1, 3)])


def test_vehicle_that_backs_out_of_a_dead_end_faces_it_in_the_plan():
    plan, fleet = plan_of_paths([[0, 1, 2, 2, 1, 3]], 5.0), fleet_of(TRICYCLE, 1)
    ways = list(zip(plan.vertex.tolist(), plan.vertex.tolist()[1:]))
    back = dict(zip(ways, driven_backward(plan, T_JUNCTION, fleet).tolist()[1:]))
    assert {route: back[route] for route in ((0, 1), (1, 2), (2, 1), (1, 3))} == {(0, 1): False, (1, 2): False, (2, 1): True, (1, 3): False}
    execution = plan_as_execution(plan, T_JUNCTION, fleet)
    out = int(np.searchsorted(execution.t_s, 17.5))  # half-way out
    assert execution.y_m[out, 0] > execution.y_m[out - 2, 0]
    assert np.sin(execution.yaw_rad[out, 0]) == pytest.approx(-1.0)


def test_how_a_vehicle_faces_at_first_tells_its_gear():
    plan, fleet = plan_of_paths([[2, 1, 3]], 5.0), fleet_of(TRICYCLE, 1)
    assert driven_backward(plan, T_JUNCTION, fleet, np.array([-np.pi / 2])).tolist() == [True, True, False]
    assert driven_backward(plan, T_JUNCTION, fleet, np.array([np.pi / 2])).tolist() == [False, False, False]


def test_robots_that_turn_in_place_go_backward_where_the_map_says_so():
    nav = nav_graph(name="dock", xy=[(0, 0), (1, 0)], lanes=[(0, 1), (1, 0)], lane_options=[{}, {"orientation_constraint": "backward"}])
    graph = plan_graph(nav, kind="roadmap", cell_m=1.0)
    assert driven_backward(plan_of_paths([[0, 1, 0]], 5.0), graph, fleet_of(SMALL_CART, 1)).tolist() == [False, False, True]


def test_racks_are_furniture_and_rooms_are_not():
    def ring(x0, y0, x1, y1):
        corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
        return [(corners[k], corners[(k + 1) % 4]) for k in range(4)]

    room, rack, stub = ring(0, 0, 9, 9), ring(2, 2, 3, 6), [((5, 5), (5, 7))]
    divided = [*ring(6, 2, 7, 3), ((7, 2), (8, 2)), ((8, 2), (8, 3)), ((8, 3), (7, 3))]
    outlines, inner, walls = furniture_and_walls(np.array(room + rack + stub + divided, float))
    assert len(walls) == 5
    assert len(inner) == 11
    assert sorted(np.ptp(o, axis=0).tolist() for o in outlines) == [[1, 4], [2, 1]]


def test_no_walls_are_no_furniture():
    outlines, inner, walls = furniture_and_walls(np.zeros((0, 2, 2)))
    assert (len(outlines), len(inner), len(walls)) == (0, 0, 0)


def test_trailers_hang_on_what_is_in_front_of_them():
    """Tuggers of a metre with the axle 0.35 m behind their middle, hitches 0.4 m behind axles and trailers of 0.7 m."""
    execution = record_of_two().execution
    angle = np.zeros_like(execution.x_m)
    bent = np.full_like(angle, np.pi / 2)
    execution = replace(execution, hitch_rad={"hitch_1_rad": angle, "hitch_2_rad": bent})
    parts = parts_of(execution, fleet_of(TUGGER, 2))
    assert parts.owner.tolist() == [0, 0, 1, 1]
    xy, yaw = (column[0] for column in parts_at(parts, execution, np.array([1.05])))
    robots = np.array([(1.55, 0.5), (0.5, 1.5)])
    first = (1.55 - 0.35 - 0.4 - 0.7, 0.5)
    second = (first[0] - 0.4, 0.5 - 0.7)  # across it, facing to +y
    assert xy[:2] == pytest.approx(np.array([first, second])) and yaw[:2] == pytest.approx([0.0, np.pi / 2])
    lines = dict(drawbars(parts, xy, yaw, robots))
    assert list(lines) == [0, 1, 2, 3]
    assert lines[0] == pytest.approx(np.array([first, (1.55 - 0.75, 0.5), (1.55, 0.5)]))
    assert lines[1] == pytest.approx(np.array([second, (first[0] - 0.4, 0.5), first]))
    assert len(parts_of(record_of_two().execution, fleet_of(TUGGER, 2)).owner) == 0  # where angles are not known


def test_a_larger_body_is_there_as_long_as_the_load_is():
    record = record_of_two()
    loads = np.zeros(record.execution.x_m.shape, np.int64)
    loads[10:20, 1] = 1
    fleet = fleet_of(replace(SMALL_CART, loaded=Loaded(length_m=1.0, width_m=0.9)), 2)
    parts = parts_of(replace(record.execution, loads=loads), fleet)
    assert parts.owner.tolist() == [0, 1] and parts.length_m.tolist() == [1.0, 1.0] and parts.width_m.tolist() == [0.9, 0.9]
    assert np.flatnonzero(np.isfinite(parts.x_m[:, 1])).tolist() == [*range(10, 20)] and np.isnan(parts.x_m[:, 0]).all()
    assert parts.y_m[10:20, 1].tolist() == record.execution.y_m[10:20, 1].tolist()
    slower = fleet_of(replace(SMALL_CART, loaded=Loaded(speed_mps=0.1)), 2)
    assert len(parts_of(replace(record.execution, loads=loads), slower).owner) == 0
    assert len(parts_of(record.execution, fleet).owner) == 0  # where loads are not known


def test_forks_are_at_the_axle_that_does_not_steer():
    front = replace(TRICYCLE, kinematics=replace(TRICYCLE.kinematics, fixed_axle="front"))
    car = replace(front, kinematics=replace(TRICYCLE.kinematics, kind="ackermann"))
    assert [forks_of(fleet_of(each, 2)).tolist() for each in (TRICYCLE, front, car, TUGGER, SMALL_CART)] == [
        [-1, -1],
        [1, 1],
        [0, 0],
        [0, 0],
        [0, 0],
    ]
