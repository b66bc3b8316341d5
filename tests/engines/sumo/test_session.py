"""Runs in sumo-gui, without a screen: plain sumo speaks the same protocol."""

from pathlib import Path
from xml.etree import ElementTree

import pytest
import sumo as sumo_package
import traci
from worlds import line, problem_of

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

    def close_the_window(t_s, at_goal):
        traci.getConnection()._process.kill()

    with pytest.raises(ExecutionError, match=r"^sumo-gui was closed before the end of the run$"):
        simulate(problem, plan, ExecutionSettings(), network, progress=close_the_window, gui=True)


def test_view_is_where_sumo_gui_is_told_to_look():
    view = Path(session.VIEW[session.VIEW.index("--gui-settings-file") + 1])
    assert ElementTree.parse(view).find("scheme").get("name") == "mrp_sumo"
