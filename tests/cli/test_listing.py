"""`mrp-sumo list` says what there is, with parameters and defaults, and what packages bring."""

import json
import sys

import pytest

from mrp_sumo.cli.main import main
from mrp_sumo.plugins import registry
from mrp_sumo.plugins.kinds import KINDS

MINE = '''
from dataclasses import dataclass
from typing import ClassVar, Literal

@dataclass(frozen=True)
class Mine:
    """Plans as I like it. Sometimes."""

    patience: int = 3
    mood: Literal["good", "bad"] = "good"
    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "none"

    def prepare(self):
        pass

    def plan(self, problem, time_limit_s):
        return None
'''


@pytest.fixture
def package(tmp_path, monkeypatch):
    """An installed package that brings a planner."""

    def install(text):
        info = tmp_path / "thing-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: thing\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text("[mrp_sumo.plugins]\nthing = listed_table:TABLE\n")
        (tmp_path / "listed_table.py").write_text('TABLE = {"planners": {"mine": "listed_mine:Mine"}}')
        (tmp_path / "listed_mine.py").write_text(text)
        monkeypatch.delitem(sys.modules, "listed_table", raising=False)
        monkeypatch.syspath_prepend(tmp_path)
        registry.forget()

    yield install
    registry.forget()


def listed(capsys, what, code=0):
    assert main(["list", what, "--json"]) == code
    return {entry["name"]: entry for entry in json.loads(capsys.readouterr().out)}


def test_planners_have_parameters_with_defaults(capsys):
    result = listed(capsys, "planners")
    assert result["ecbs"]["parameters"]["w"] == {"type": "a number", "default": 1.2}
    assert result["ecbs"]["guarantee"] == "w-bounded"
    assert result["cbs_ta"]["assigns"] is True


def test_policies_have_parameters_with_defaults(capsys):
    result = listed(capsys, "policies")
    assert result["adg"]["parameters"] == {"look_ahead": {"type": "a whole number", "default": 4}}
    assert result["adg"]["sound_plan_only"] is True


def test_metrics_have_unit_and_sense(capsys):
    result = listed(capsys, "metrics")
    assert result["lateness_max_s"]["unit"] == "s"
    assert result["lateness_max_s"]["sense"] == "less"


@pytest.mark.parametrize(
    ("what", "name"),
    [
        ("maps", "office"),
        ("robots", "turtlebot3"),
        ("scenarios", "office_9"),
        ("suites", "paper_table_1"),
        ("logs", "warehouse_hour"),
        ("disturbances", "nav2_like"),
    ],
)
def test_files_of_the_program_are_listed(capsys, what, name):
    assert name in listed(capsys, what)


@pytest.mark.parametrize("what", KINDS)
def test_every_kind_has_a_table_for_people(capsys, what):
    assert main(["list", what]) == 0
    assert capsys.readouterr().out


def test_planner_of_a_package_is_listed_like_ours(package, capsys):
    package(MINE)
    assert listed(capsys, "planners")["mine"] == {
        "name": "mine",
        "summary": "Plans as I like it",
        "assigns": False,
        "guarantee": "none",
        "parameters": {
            "patience": {"type": "a whole number", "default": 3},
            "mood": {"type": "one of 'good', 'bad'", "default": "good"},
        },
        "source": "thing 1.0",
    }


@pytest.mark.parametrize(
    ("text", "says"),
    [("import os; os._exit(0)", "listed_mine.py: ended its process with exit code 0"), ("1 / 0", "listed_mine.py:1: ZeroDivisionError")],
)
def test_package_that_cannot_be_loaded_is_a_line_and_the_others_are_listed(package, capsys, text, says):
    package(text)
    assert main(["list", "planners", "--json"]) == 1
    output = capsys.readouterr()
    assert len(json.loads(output.out)) >= 11
    assert output.err.startswith("mrp-sumo: planner 'mine': ")
    assert says in output.err
    assert output.err.count("\n") == 1


def test_unknown_word_names_the_nearest(capsys):
    assert main(["list", "planers"]) == 2
    assert capsys.readouterr().err == "mrp-sumo: cannot list 'planers' (did you mean 'planners'?)\n"


def test_types_of_robots_are_a_table_of_a_hundred_columns(capsys):
    assert main(["list", "robots"]) == 0
    lines = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    assert max(map(len, lines[:-1])) <= 100
    (tugger,) = [line.split() for line in lines if line.startswith("tugger")]
    assert tugger == ["tugger", "1.40", "x", "0.80", "1.2", "tugger", "r", "1.07", "1", "3", "3"]  # loaded speed, loads, trailers
    (lift,) = [line for line in lines if line.startswith("amr_lift")]
    assert "1.2, 1.00 x 0.80" in lift
    assert main(["list", "robots", "--json"]) == 0
    entries = {entry["name"]: entry for entry in json.loads(capsys.readouterr().out)}
    assert entries["tugger"]["capacity"] == 3 and len(entries["tugger"]["trailers"]) == 3 and entries["omni_mover"]["summary"]
