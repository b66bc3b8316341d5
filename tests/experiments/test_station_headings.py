"""Headings in which vehicles that cannot turn in place are served, on a square road that they may drive either way round."""

import numpy as np
import pytest
from floors import driven, lanes, ring, scenario

from mrp_sumo.drive.crew import Crew
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.audit_work import logs_of
from mrp_sumo.metrics.operations.audit import in_words, operations_audit

TRUCK = {"turn_rate_rad_s": None, "kinematics": {"kind": "tricycle", "wheelbase_m": 0.25, "steering_max_rad": 1.0, "reverse": True}}


def tasks(heading_deg):
    return {"stations": {"top": {"places": ["B"], "heading_deg": heading_deg}}, "list": [{"stops": ["A", "top"], "service_s": 5.0}] * 2}


def square(folder):
    """A in the middle of the lower side, B in that of the upper one, and lanes both ways."""
    xy = {"c1": (0.0, 0.0), "A": (5.0, 0.0), "c2": (10.0, 0.0), "c3": (10.0, 10.0), "B": (5.0, 10.0), "c4": (0.0, 10.0)}
    names = list(xy)
    return lanes(folder / "square.csv", xy, zip(names, names[1:] + names[:1]), True)


def refused(file):
    with pytest.raises(MrpSumoError) as error:
        driven(file)
    return str(error.value)


@pytest.mark.parametrize("heading_deg", [0, 180])
def test_a_vehicle_is_served_in_the_heading_of_the_station(tmp_path, heading_deg):
    result = driven(scenario(square(tmp_path), tasks(heading_deg), starts=["A"], shape=TRUCK))
    stops, run = logs_of(result).stops, result.execution
    assert result.status == "completed"
    begin_s = stops.begin_s[np.array(stops.station) == "top"]
    assert len(begin_s) == 2
    yaw = np.degrees(run.yaw_rad[np.searchsorted(run.t_s, begin_s), 0])
    assert np.cos(np.radians(yaw - heading_deg)) == pytest.approx(1.0, abs=1e-6)


def test_the_audit_finds_who_is_served_in_another_heading(tmp_path, monkeypatch):
    monkeypatch.setattr(Crew, "end_heading_rad", lambda *_: None)
    said = [in_words(operations_audit(logs_of(driven(scenario(square(tmp_path), tasks(h), starts=["A"], shape=TRUCK))))) for h in (0, 180)]
    assert sorted("is served 180 degrees from the heading of the station" in text for text in said) == [False, True]


def test_a_heading_in_which_nobody_can_come_is_refused(tmp_path):
    """The ring leads to B in one direction."""
    forward = {**TRUCK, "kinematics": {**TRUCK["kinematics"], "reverse": False}}
    said = refused(scenario(ring(tmp_path), tasks(0), starts=["A"], shape=forward))
    assert "tasks.stations.top.heading_deg: found 0, but 'custom' cannot come to 'B' so, expected one of 180" in said


def test_a_heading_for_robots_that_turn_in_place_is_refused(tmp_path):
    assert "heading_deg: has no effect" in refused(scenario(ring(tmp_path), tasks(180), starts=["A"]))
