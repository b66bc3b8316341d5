"""Vehicles that cannot turn in place, at work at stations where lanes meet at a bend."""

from dataclasses import replace

import numpy as np
import pytest
from floors import driven, lanes, ring, scenario

from mrp_sumo.errors import ScenarioError
from mrp_sumo.experiments.audit_work import logs_of
from mrp_sumo.metrics.operations import places

CAR = {"turn_rate_rad_s": None, "kinematics": {"kind": "ackermann", "wheelbase_m": 0.3, "steering_max_rad": 0.6}}


ROADS = {"discretisation": {"kind": "roadmap", "cell_m": 2.0}}


def orders(*stops):
    return {"streams": [{"name": "o", "stops": list(stops), "service": [5], "arrivals": {"open": 2}}]}


@pytest.fixture(scope="module")
def at_corners(tmp_path_factory):
    """A car that is served at two corners of the one-way ring, where it can only stop on the arc if it is to go on."""
    result = driven(scenario(ring(tmp_path_factory.mktemp("ring")), orders("c2", "c4"), starts=["c1"], shape=CAR, **ROADS))
    assert result.status == "completed" and not result.operations_audit["findings"], result.note
    return logs_of(result)


def test_who_is_served_at_a_corner_may_be_on_the_arc(at_corners):
    stops = at_corners.stops
    away = at_corners.xy_at(stops.robot, stops.begin_s) - at_corners.graph.xy[stops.vertex]
    assert len(away) > 5 and 0.05 < np.hypot(*away.T).max() <= at_corners.fleet.aside_m[0]


def test_who_is_served_on_a_straight_lane_is_at_the_place(tmp_path):
    logs = logs_of(driven(scenario(ring(tmp_path), orders("A", "B"), starts=["c1"], shape=CAR, **ROADS)))
    assert not list(places.service(logs))
    moved = replace(logs, execution=replace(logs.execution, x_m=logs.execution.x_m + 0.1))
    assert len(list(places.service(moved))) == len(logs.stops.task)


def test_who_is_served_before_a_lane_of_no_return_can_go_on(tmp_path):
    """Straight on from the corner c2 is a lane from which nobody comes back; the other way on begins on the arc."""
    xy = {"c1": (0.0, 0.0), "c2": (10.0, 0.0), "c3": (10.0, 10.0), "c4": (0.0, 10.0), "x": (14.0, 0.0)}
    pairs = [("c1", "c2"), ("c2", "c3"), ("c3", "c4"), ("c4", "c1"), ("c2", "x")]
    result = driven(scenario(lanes(tmp_path / "trap.csv", xy, pairs, False), orders("c2", "c4"), starts=["c1"], shape=CAR, **ROADS))
    assert result.status == "completed" and not result.operations_audit["findings"], result.note
    assert sum(status == "done" for status in result.execution.tasks.status) >= 3


def test_a_stop_from_which_a_type_does_not_come_back_is_refused_with_the_reason(tmp_path):
    """On a one-way ring with a spur from c2 to x, and back."""
    xy = {"c1": (0.0, 0.0), "c2": (10.0, 0.0), "c3": (10.0, 10.0), "c4": (0.0, 10.0), "x": (20.0, 0.0)}
    pairs = [("c1", "c2"), ("c2", "c3"), ("c3", "c4"), ("c4", "c1"), ("c2", "x"), ("x", "c2")]
    says = r"no robot can reach 'x' after 'c2', a stop of 'o': custom cannot reverse, from 'v\d+' to 'x' and back"
    with pytest.raises(ScenarioError, match=says):
        driven(scenario(lanes(tmp_path / "spur.csv", xy, pairs, False), orders("c2", "x"), starts=["c1"], shape=CAR, **ROADS))
