"""The workbench in a real browser, from a picture of a hall to an answer.

Needs Chromium, playwright-core and axe-core; `tools/browser.sh` installs them.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image, ImageDraw

from mrp_sumo.cli.main import main
from mrp_sumo.maps.catalogue import bundled_maps
from tests.studio.test_workspace import draw

PROJECT = Path(__file__).resolve().parents[2]
MODULES = os.environ.get("NODE_PATH") or str(PROJECT / ".venv" / "node" / "node_modules")
CLAIMS = (
    "a picture without a scale asks for it",
    "two places and their distance are the scale",
    "lanes are laid over the free floor",
    "undo takes back",
    "redo brings back",
    "stations have names and kinds",
    "Ctrl+S saves",
    "orders are proposed and valid",
    "a field changes the text and keeps its comments",
    "the text's errors are those of the command",
    "the text changes the fields",
    "a run is watched in place",
    "its replay follows",
    "waits are drawn over the plan",
    "a study fills in while it runs",
    "it has an answer",
    "another program's change is shown",
    "a conflict writes nothing and offers three ways",
    "the keyboard alone draws",
    "it leaves as a LIF",
    "asks no other server",
    "no console error",
)
DRAWING = (
    "an empty floor has a scale",
    "walls close where they began",
    "lanes join lanes",
    "a rack is four walls",
    "an aisle with its rack is repeated",
    "a lane joins all that it crosses",
    "a lane is bent to an arc",
    "a lane has a direction, a limit and a width, and turns round",
    "a door has two ends",
    "a zone without robots is a floor that says so",
    "and goes with its corners",
    "a lane joins no corner of walls",
    "a vertex is dragged on the grid",
    "what is mirrored twice is as it was",
    "a rack is copied",
    "what is deleted leaves no loose corner",
    "no lane is left in what is cleared",
    "what was drawn can be driven on",
    "it is saved as a LIF, too",
    "no console error",
)


LEVELS = (
    "a level has another name",
    "a level is added above, where the other one is",
    "a level has an elevation",
    "a number stays selected while its panel is made anew",
    "a lift serves all levels",
    "its shaft has a place on each",
    "a lift has a size, a name, and doors on each level",
    "a lift is dragged with its places on all levels",
    "what a level lacks is found",
    "both levels can be driven on",
    "a level is copied onto another, under names of its own",
    "a level is deleted",
    "orders are proposed over both levels",
    "no console error",
)


WHAT_IF = (
    "a lane is doubled where there is room, traffic to the right",
    "its twin joins the lanes that it meets",
    "one click keeps it and compares it on the same orders",
    "the first layout of the comparison is the one that was saved",
    "the layout is as it was",
    "the variant says the rest as the layout does",
    "a charger is dragged onto another lane, and its lanes stay",
    "undo takes it back",
    "a variant is taken over",
    "no console error",
)


WINDOWS = (
    "what one window saves, the other shows",
    "a window with changes of its own keeps them, and asks",
    "a save over another's is refused, and nothing is written",
    "one window's work is saved under another name",
    "and the other's is as it was",
    "layers of a plan are chosen with what they hold",
    "a plan without a unit cannot be opened before one is chosen",
    "the chosen layer alone is wall",
    "parts that are none are told, and nothing breaks",
    "no console error",
)


STEPS = ("1 Floor", "2 Draw", "3 Orders", "4 Run", "5 Ask", "6 Leave")
ACCESSIBLE = {
    *(f"{step}, {theme}: no violation" for step in STEPS for theme in ("light", "dark")),
    *(f"{step}: all of it by Tab" for step in STEPS),
    "no console error",
}


ODD = """name: odd
levels:
  L1: {elevation: 0, vertices: [[0, 0, 0, ""], [9, 9, 0, ""]], lanes: [], fiducials: [3]}
  L2: [1]
lifts:
  a: null
  b: {x: 1, y: 2, yaw: 0, width: 2, depth: 2, doors: {d: null}, level_doors: {L1: d}}
"""


def hall(path):
    """30 x 20 m at 5 cm a pixel, with five racks."""
    image = Image.new("RGB", (640, 440), "white")
    draw = ImageDraw.Draw(image)
    draw.rectangle((20, 20, 619, 419), outline="black", width=4)
    for k in range(5):
        draw.rectangle((110 + 90 * k, 110, 140 + 90 * k, 330), fill="dimgray")
    image.save(path)


def started(place, cwd):
    """A process with a workbench, which prints its address."""
    command = [sys.executable, "-P", "-m", "mrp_sumo", "studio", str(place), "--no-browser", "--json"]
    return subprocess.Popen(command, cwd=cwd, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": str(PROJECT)})


def claims(folder, script, *words):
    """Claims that a script makes about a workbench over a folder, all of which hold."""
    chromium, node = shutil.which("chromium"), shutil.which("node")
    if not chromium or not node or not all((Path(MODULES) / name).is_dir() for name in ("playwright-core", "axe-core")):
        pytest.skip("no chromium, node, playwright-core or axe-core (tools/browser.sh installs them)")
    with started(folder, folder) as process:
        try:
            address = json.loads(process.stdout.readline())["address"]
            command = [node, Path(__file__).with_name(script), chromium, address, *words]
            output = subprocess.run(command, capture_output=True, text=True, timeout=900, env={**os.environ, "NODE_PATH": MODULES})
        finally:
            process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0
    result = {line["claim"]: line for line in (json.loads(text) for text in output.stdout.split("\n") if text.startswith("{"))}
    assert not [line for line in result.values() if not line["holds"]]
    return list(result)


@pytest.mark.slow
def test_a_site_is_drawn_from_nothing_with_every_tool(tmp_path, capsys):
    assert claims(tmp_path, "drawing.mjs") == list(DRAWING)
    assert main(["import", str(tmp_path / "site.building.yaml"), "--check"]) == 0
    assert "warn" not in capsys.readouterr().out


@pytest.mark.slow
def test_two_levels_and_their_lift_are_drawn_from_nothing_and_driven(tmp_path, capsys):
    assert claims(tmp_path, "levels.mjs", tmp_path) == list(LEVELS)
    assert main(["import", str(tmp_path / "tower.building.yaml"), "--check"]) == 0
    assert "nothing to report" in capsys.readouterr().out
    run = tmp_path / "run"
    assert main(["run", str(tmp_path / "tower/scenario.yaml"), "--set", "execution.engine=kinematic", "--out", str(run)]) == 0
    metrics = json.loads((run / "result.json").read_text())["metrics"]
    assert metrics["tasks_done"] > 0  # from the ground floor to the one above


@pytest.mark.slow
def test_a_change_becomes_a_variant_and_is_compared(tmp_path):
    assert claims(tmp_path, "what_if.mjs", tmp_path) == list(WHAT_IF)


@pytest.mark.slow
def test_each_step_can_be_read_and_reached_by_everybody(tmp_path):
    shutil.copy(bundled_maps()["office"], tmp_path)
    (tmp_path / "day.yaml").write_text("map: office.building.yaml\nrobots: {count: 2}\nplanner: auto\n")
    assert set(claims(tmp_path, "accessible.mjs", tmp_path)) == ACCESSIBLE


@pytest.mark.slow
def test_two_windows_work_on_one_folder(tmp_path):
    shutil.copy(bundled_maps()["office"], tmp_path)
    draw(tmp_path / "hall.dxf")
    (tmp_path / "odd.building.yaml").write_text(ODD)
    assert claims(tmp_path, "windows.mjs", tmp_path) == list(WINDOWS)


@pytest.mark.slow
def test_from_a_picture_to_an_answer(tmp_path, capsys):
    hall(tmp_path / "hall.png")
    assert claims(tmp_path, "browser.mjs", tmp_path) == list(CLAIMS)
    assert main(["import", str(tmp_path / "hall.building.yaml"), "--check"]) == 0  # the command line reads what was drawn
    assert "refuse" not in capsys.readouterr().out


@pytest.mark.slow
def test_a_server_killed_while_it_saves_leaves_a_whole_file(tmp_path):
    """The file is what it was or what it was to be, whenever the kill comes."""
    path = tmp_path / "airport.building.yaml"
    shutil.copy(bundled_maps()["airport"], path)
    before = path.read_bytes()
    script = tmp_path / "save.py"
    script.write_text(
        "import sys\n"
        "from pathlib import Path\n"
        "from mrp_sumo.studio.workspace import Workspace\n"
        "folder = Workspace(Path(sys.argv[1]).resolve())\n"
        "opened = folder.open('airport.building.yaml', {})\n"
        "digest, n = opened['digest'], 0\n"
        "print('ready', flush=True)\n"
        "while True:\n"
        "    n += 1\n"
        "    opened['document']['levels']['L1']['vertices'][0][3] = f'name_{n % 2}'\n"
        "    digest = folder.save_drawing('airport.building.yaml', opened['document'], digest)\n"
        "    print(n, flush=True)\n"
    )
    for saves in (1, 2, 3):
        command, environment = [sys.executable, "-P", script, tmp_path], {**os.environ, "PYTHONPATH": str(PROJECT)}
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
            for _ in range(1 + saves):
                process.stdout.readline()
            process.kill()
        text = path.read_bytes()
        assert text.replace(b"name_0", b"name_1").count(b"name_1") == 1
        assert len(text.splitlines()) == len(before.splitlines())
