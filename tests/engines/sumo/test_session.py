"""Runs in sumo-gui, without a screen: plain sumo speaks the same protocol."""

from pathlib import Path
from xml.etree import ElementTree

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
