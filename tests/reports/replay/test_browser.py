"""The replay page in a real browser: it plays, seeks, picks, searches, fits a phone, and the console stays silent.

Needs Chromium and playwright-core; `tools/browser.sh` installs both.
"""

import json
import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from worlds import NASTY, record_of_two

from mrp_sumo.core.graph import nav_graph
from mrp_sumo.experiments.run import run_scenario
from mrp_sumo.io.run_reader import load_run
from mrp_sumo.io.scenario.file import find_scenario
from mrp_sumo.io.scenario.read import read_scenario
from mrp_sumo.reports.replay.beside import page_of_two
from mrp_sumo.reports.replay.page import About, replay_page, write_replay

PROJECT = Path(__file__).resolve().parents[3]
MODULES = os.environ.get("NODE_PATH") or str(PROJECT / ".venv" / "node" / "node_modules")

CLAIMS = (
    "opens",
    "paints",
    "paints the same with and without WebGL",
    "plays",
    "pauses",
    "space plays",
    "seeks by a click on the track",
    "seeks by dragging",
    "seeks by keys",
    "picks a robot",
    "shows its plan",
    "address tells robot and time",
    "lets go",
    "an event leads to its time",
    "finds a robot",
    "finds a station",
    "wheel zooms",
    "key t switches",
    "key g switches",
    "key l switches",
    "an aisle's diagram leads to its time",
    "a click on a lane shows its aisle",
    "heat map shows",
    "dark mode",
    "asks no network",
    "no console error",
    "follows the system's dark",
    "a tap picks",
    "a phone needs no sideways scrolling",
    "a pinch zooms",
    "no console error on a phone",
    "a phone begins with the level of most robots, a wide screen with all",
    "names are text",
    "two runs open at a moment, and what differs is marked",
    "draws trailers with and without WebGL",
    "says that it needs WebGL",
)


@pytest.mark.slow
def test_page_does_what_people_expect(tmp_path, trains):  # one test: the browser is started once, whoever runs it
    chromium, node = shutil.which("chromium"), shutil.which("node")
    if not chromium or not node or not (Path(MODULES) / "playwright-core").is_dir():
        pytest.skip("no chromium, node or playwright-core (tools/browser.sh installs them)")
    overrides = {("planner", "name"): ("--planner", "prioritised"), ("record", "bag"): ("", False)}
    run_scenario(read_scenario(find_scenario("office_5"), overrides), tmp_path / "run")
    page = write_replay(tmp_path / "run", tmp_path / "page.html")
    (tmp_path / "nasty.html").write_text(replay_page(record_of_two(names=(NASTY, "b")), About(NASTY, note=NASTY)), encoding="utf-8")
    two = nav_graph(name="two", xy=[[-9, 0], [-4, 0], [0, 0], [4, 2]], lanes=[[0, 1], [2, 3]], level_names=("L1", "L2"), level=[0, 0, 1, 1])
    (tmp_path / "levels.html").write_text(replay_page(replace(record_of_two(), nav=two), About("levels")), encoding="utf-8")
    late = overrides | {("execution", "disturbances", "start_delay_s"): ("", 20.0), ("execution", "disturbances", "seed"): ("", 1)}
    run_scenario(read_scenario(find_scenario("office_5"), late), tmp_path / "late")
    (tmp_path / "both.html").write_text(page_of_two(load_run(tmp_path / "run"), load_run(tmp_path / "late")), encoding="utf-8")
    pages = [page, tmp_path / "nasty.html", tmp_path / "both.html", write_replay(trains, tmp_path / "trains.html")]
    command = [node, Path(__file__).with_name("browser.mjs"), chromium, *pages, tmp_path]
    output = subprocess.run(command, capture_output=True, text=True, timeout=240, env={**os.environ, "NODE_PATH": MODULES})
    result = {line["claim"]: line for line in (json.loads(text) for text in output.stdout.split("\n") if text.startswith("{"))}
    assert not [line for line in result.values() if not line["holds"]]
    assert output.returncode == 0, output.stderr[-2000:]
    assert list(result) == list(CLAIMS)
