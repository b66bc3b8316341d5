"""Runs in sumo-gui, without a screen: plain sumo speaks the same protocol."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import sumo as sumo_package
import traci
from worlds import line, problem_of

from mrp_sumo.drive.listeners import ProgressReport
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.engines.sumo import session
from mrp_sumo.engines.sumo.network import build_network
from mrp_sumo.errors import ExecutionError


def test_closing_the_window_ends_the_run_with_a_sentence(tmp_path, monkeypatch):
    problem, plan = problem_of(line(4), [[0, 1, 2, 3]])
    network = build_network(line(4), tmp_path / "world.net.xml")
    monkeypatch.setattr(session, "_api", lambda gui: (traci, str(Path(sumo_package.SUMO_HOME) / "bin" / "sumo")))
    monkeypatch.setattr(session, "VIEW", ())
    monkeypatch.setenv("DISPLAY", ":0")  # plain sumo does not look there

    def close_the_window(t_s, at_goal):
        traci.getConnection()._process.kill()

    with pytest.raises(ExecutionError, match=r"^sumo-gui was closed before the end of the run$"):
        simulate(problem, plan, ExecutionSettings(), network, listeners=[ProgressReport(close_the_window)], gui=True)


@pytest.mark.parametrize(
    ("display", "message"),
    [
        (None, r"^sumo-gui needs a display, and there is none \(DISPLAY is not set\); --live shows the run in a browser$"),
        (":4711", r"^sumo-gui ended as it started, DISPLAY is ':4711'; --live shows the run in a browser$"),
    ],
)
def test_gui_without_a_display_is_refused_in_one_line(tmp_path, monkeypatch, capfd, display, message):
    monkeypatch.delenv("DISPLAY", raising=False)
    if display:
        monkeypatch.setenv("DISPLAY", display)
    problem, plan = problem_of(line(4), [[0, 1, 2, 3]])
    network = build_network(line(4), tmp_path / "world.net.xml")
    with pytest.raises(ExecutionError, match=message):
        simulate(problem, plan, ExecutionSettings(), network, gui=True)
    assert capfd.readouterr() == ("", "")


def test_view_is_where_sumo_gui_is_told_to_look():
    view = Path(session.VIEW[session.VIEW.index("--gui-settings-file") + 1])
    assert ElementTree.parse(view).find("scheme").get("name") == "mrp_sumo"


@pytest.mark.parametrize("faces_the_way_back", [True, False])
def test_odometer_of_a_robot_that_turns_back_counts_from_the_step_in_which_it_sets_out(tmp_path, faces_the_way_back):
    """One that has to turn first stands in that step; one that was turned already drives in it."""
    graph = line(4)
    network = build_network(graph, tmp_path / "world.net.xml")
    fleet, driven_m, moving = problem_of(graph, [[0, 3]])[0].fleet, np.zeros(1), np.ones(1, np.bool_)
    with session.running_sumo(network, fleet, 0.1, 0) as sumo:
        sumo.insert(0, 0, ["e0_1", "e1_2", "e2_3"], False, False)
        sumo.begin()
        for speed_mps in (*[0.2] * 10, 0.0):
            sumo.set_speed("robot_0", speed_mps)
            sumo.step()
            sumo.read_driven(driven_m, moving)
        before_m = float(driven_m[0])
        sumo.turn_back(0, "e1_0", [], True, before_m)
        for step in range(3):
            sumo.set_speed("robot_0", 0.2 if step or faces_the_way_back else 0.0)
            sumo.step()
            sumo.read_driven(driven_m, moving)
    assert before_m == pytest.approx(0.2)
    assert driven_m[0] - before_m == pytest.approx(0.06 if faces_the_way_back else 0.04)
