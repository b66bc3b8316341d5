"""Runs in which nobody moves: every robot is at its goal already."""

import json
import warnings

import pytest

from mrp_sumo.cli.main import main

pytestmark = pytest.mark.slow

STILL = """\
map: office
discretisation: {kind: roadmap, cell_m: 0.4}
robots: {type: turtlebot3, starts: [office_1, lobby], goals: [office_1, lobby]}
assignment: {mode: fixed}
planner: prioritised
"""
PEOPLE = "people:\n  groups: [{name: staff, share: 5}]\n  flows: [{origin: [lobby], destination: [office_1], rate_per_h: 400}]\n"


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    """A run among people, its VDA 5050 messages, and the run that these are read as."""
    folder = tmp_path_factory.mktemp("still")
    (folder / "still.yaml").write_text(STILL + PEOPLE)
    assert main(["run", str(folder / "still.yaml"), "--out", str(folder / "run")]) == 0
    assert main(["export", str(folder / "run"), "--vda5050", "--out", str(folder / "vda")]) == 0
    assert main(["import", str(folder / "vda" / "messages.jsonl"), "--out", str(folder / "recorded")]) == 0
    return folder


def test_run_takes_no_time_and_is_completed(still):
    result = json.loads((still / "run" / "result.json").read_text())
    assert (result["status"], result["metrics"]["sim_time_s"], result["metrics"]["protective_stops_per_robot_h"]) == ("completed", 0, None)


@pytest.mark.parametrize("name", ["run", "recorded"])
@pytest.mark.parametrize(
    "line", ["report {} --out {}.page", "replay {} --out {}.html", "render {} --at 0 --out {}.png", "export {} --csv --out {}.csv"]
)
def test_run_is_shown_without_a_warning(still, name, line, capsys):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert main(line.format(still / name, still / name).split()) == 0
    assert capsys.readouterr().err == ""


def test_video_of_no_time_is_refused_in_a_line_that_says_what_can_be_drawn(still, capsys):
    assert main(["render", str(still / "run"), "--video", str(still / "film.gif")]) == 2
    assert capsys.readouterr().err == "mrp-sumo: nobody moved, the run lasts 0 s: a picture shows it, --at 0 --out FILE\n"


def test_recorded_run_has_no_network_of_lanes_and_is_not_made_again(still, capsys):
    assert (still / "run" / "network.net.xml").is_file() and not (still / "recorded" / "network.net.xml").exists()
    assert main(["reproduce", str(still / "recorded")]) == 2
    assert "was read from a log, not driven here" in capsys.readouterr().err
