"""Headings in which vehicles that cannot turn in place are served, on a square road that they may drive either way round."""

import json

import numpy as np
import pytest
from floors import driven, lanes, ring, scenario

from mrp_sumo.drive.crew import Crew
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.audit_work import logs_of
from mrp_sumo.metrics.operations.audit import in_words, operations_audit

TRUCK = {"turn_rate_rad_s": None, "kinematics": {"kind": "tricycle", "wheelbase_m": 0.25, "steering_max_rad": 1.0, "reverse": True}}


def tasks(heading_deg):
    station = {"places": ["B"]} if heading_deg is None else {"places": ["B"], "heading_deg": heading_deg}
    return {"stations": {"top": station}, "list": [{"stops": ["A", "top"], "service_s": 5.0}] * 2}


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


def graph_of(table, **options):
    """The map of a table of lanes as a graph of JSON, with options of its vertices."""
    rows = [line.split(",") for line in table.read_text().splitlines()[1:]]
    xy = {row[0]: row[2:4] for row in rows} | {row[1]: row[4:6] for row in rows}
    nodes = [{"id": name, "x_m": float(x), "y_m": float(y), **options.get(name, {})} for name, (x, y) in xy.items()]
    links = [{"source": a, "target": b} for row in rows for a, b in ((row[0], row[1]), (row[1], row[0]))]
    path = table.with_suffix(".json")
    path.write_text(json.dumps({"directed": True, "nodes": nodes, "links": links}))
    return path


@pytest.mark.parametrize("heading_rad", [0.0, np.pi])
@pytest.mark.parametrize("named", [True, False])
def test_a_vehicle_is_served_in_the_heading_that_the_map_has(tmp_path, heading_rad, named):
    request = tasks(None) if named else {"list": [{"stops": ["A", "B"], "service_s": 5.0}] * 2}
    result = driven(scenario(graph_of(square(tmp_path), B={"theta_rad": heading_rad}), request, starts=["A"], shape=TRUCK))
    stops, run = logs_of(result).stops, result.execution
    assert result.status == "completed"
    begin_s = stops.begin_s[np.array(stops.station) == ("top" if named else "B")]
    yaw = run.yaw_rad[np.searchsorted(run.t_s, begin_s), 0]
    assert len(yaw) == 2 and np.cos(yaw - heading_rad) == pytest.approx(1.0, abs=1e-6)


def test_a_key_counts_more_than_the_map(tmp_path):
    result = driven(scenario(graph_of(square(tmp_path), B={"theta_rad": 0.0}), tasks(180), starts=["A"], shape=TRUCK))
    stops, run = logs_of(result).stops, result.execution
    begin_s = stops.begin_s[np.array(stops.station) == "top"]
    assert np.cos(run.yaw_rad[np.searchsorted(run.t_s, begin_s), 0] - np.pi) == pytest.approx(1.0, abs=1e-6)


def test_a_heading_of_the_map_in_which_nobody_can_come_is_said(tmp_path):
    result = driven(scenario(graph_of(square(tmp_path), B={"theta_rad": 1.0}), tasks(None), starts=["A"], shape=TRUCK))
    assert result.status == "completed"
    assert "'custom' cannot come to 'B' at 57.2958 degrees, as the map has it" in result.note
