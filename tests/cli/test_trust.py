"""Programs that strangers' files name run only when the user trusts them."""

import os
import subprocess
import sys

import pytest

import mrp_sumo as ms
from mrp_sumo.cli.main import main

PLANNER = """
from pathlib import Path
Path(__file__).with_name("RAN").touch()
from planners.astar import AStar as Mine
"""
METRIC = 'from pathlib import Path\nPath(__file__).with_name("RAN").touch()\ndef mine(evidence):\n    return 1.0\n'
READER = (
    'from pathlib import Path\nPath(__file__).with_name("RAN").touch()\nfrom mrp_sumo.maps.readers.movingai import MovingAiMap as Mine\n'
)
HEAD = "robots: 2\nassignment: {mode: fixed}\nrecord: {bag: false}\n"
COMMAND = "sh -c 'touch RAN' {out}"
SCENARIOS = {
    "planner": f"map: office\n{HEAD}planner: ./planner.py:Mine\n",
    "policy": f"map: office\n{HEAD}execution: {{policy: ./planner.py:Mine}}\n",
    "replanner": f"map: office\n{HEAD}execution: {{on_deadlock: resolve, recovery: {{replanner: ./planner.py:Mine}}}}\n",
    "assigner": "map: office\nrobots: 2\nassignment: {solver: ./planner.py:Mine}\n",
    "metric": "map: office\nrobots: 2\nrecord: {bag: false, metrics: [./metric.py:mine]}\n",
    "reader": f"map: {{file: plain.map, reader: ./reader.py:Mine}}\n{HEAD}",
    "command": f'map: office\n{HEAD}planner: {{name: external, parameters: {{command: "{COMMAND}"}}}}\n',
}


@pytest.fixture
def folder(tmp_path, monkeypatch, nothing_trusted):
    """A stranger's folder, which is the current one."""
    place = tmp_path / "stranger"
    place.mkdir()
    for name, text in (("planner.py", PLANNER), ("metric.py", METRIC), ("reader.py", READER)):
        (place / name).write_text(text)
    (place / "plain.map").write_text("type octile\nheight 2\nwidth 3\nmap\n...\n...\n")
    for name, text in SCENARIOS.items():
        (place / f"{name}.yaml").write_text(text)
        base = "".join(f"  {line}\n" for line in text.splitlines())
        (place / f"suite_{name}.yaml").write_text(f"base:\n{base}grid_search: {{seed: [1, 2]}}\nuntil: plan\n")
    monkeypatch.chdir(place)
    return place


def refusal(capsys, folder):
    """The one line of a refusal; nothing was run and nothing is left."""
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and lines[0].startswith("mrp-sumo: ")
    assert not (folder / "RAN").exists() and not (folder / "out").exists()
    return lines[0]


@pytest.mark.parametrize("name", SCENARIOS)
@pytest.mark.parametrize("command", ["run", "plan", "batch"])
def test_programs_of_a_stranger_do_not_run(folder, capsys, command, name):
    file = f"suite_{name}.yaml" if command == "batch" else f"{name}.yaml"
    assert main([command, file, *([] if command == "plan" else ["--out", "out"])]) == 2
    line = refusal(capsys, folder)
    assert f"{file}:" in line and "would run" in line and f"mrp-sumo trust {folder}" in line
    assert (COMMAND if name == "command" else ".py") in line


@pytest.mark.parametrize("name", SCENARIOS)
def test_validate_and_dry_run_run_no_program_even_when_trusted(folder, capsys, name):
    main(["trust", str(folder)])
    (folder / "plan.json").write_text('{"schema_version": 1, "step_s": 1, "robots": []}')
    assert main(["validate", "plan.json", "--scenario", f"{name}.yaml"]) in (1, 2)
    assert main(["batch", f"suite_{name}.yaml", "--dry-run"]) == 0
    assert not (folder / "RAN").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    [
        ["plan", "planner.yaml", "--trust"],
        ["plan", "office_5", "--planner", "planner.py:Mine"],
        ["plan", "office_5", "--set", "planner=planner.py:Mine"],
        ["plan", "planner.yaml", "--planner", "./planner.py:Mine"],
        ["plan", "office_5", "--command", COMMAND],
        ["plan", "--map", "plain.map", "--robots", "1", "--planner", "planner.py:Mine"],
        ["import", "plain.map", "--reader", "reader.py:Mine", "--json"],
        ["run", "office_5", "--metric", "metric.py:mine", "--out", "out"],
        ["batch", "suite_planner.yaml", "--out", "out", "--workers", "1", "--trust"],
        ["batch", "suite_command.yaml", "--out", "out", "--workers", "1", "--trust"],
    ],
)
def test_program_that_the_user_names_or_trusts_runs(folder, arguments):
    assert main(arguments) in (0, 1)
    assert (folder / "RAN").exists()


def test_option_beside_a_program_does_not_trust_it(folder, capsys):
    for option in ("planner.time_limit_s=3", "seed=2", "planner={time_limit_s: 3}"):
        assert main(["plan", "command.yaml", "--set", option]) == 2
        assert "would run" in refusal(capsys, folder)
    main(["plan", "command.yaml", "--planner", "external"])  # whose command is dropped with the planner
    capsys.readouterr()
    assert main(["plan", "replanner.yaml", "--set", "execution.recovery={patience_s: 3}"]) == 2
    assert "would run" in refusal(capsys, folder)


@pytest.mark.slow
def test_folder_is_trusted_once_and_can_be_forgotten(folder, capsys):
    assert main(["trust", "."]) == 0
    assert main(["trust", "--list"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == str(folder)
    assert [file.name for file in (folder.parent / "config" / "mrp-sumo").iterdir()] == ["trusted"]
    assert main(["trust", "--forget", "."]) == 0
    assert main(["plan", "planner.yaml"]) == 2
    capsys.readouterr()
    main(["trust", str(folder)])
    assert main(["plan", "planner.yaml"]) in (0, 1)
    assert (folder / "RAN").exists()


def test_trusted_suite_does_not_vouch_for_the_base_of_a_stranger(folder, capsys):
    mine = folder.parent / "mine"
    mine.mkdir()
    (mine / "suite.yaml").write_text("base: ../stranger/planner.yaml\ngrid_search: {seed: [1]}\n")
    main(["trust", str(mine)])
    assert main(["batch", str(mine / "suite.yaml"), "--out", "out"]) == 2
    assert f"mrp-sumo trust {folder}" in refusal(capsys, folder)


@pytest.mark.parametrize("arguments", [[], ["nowhere"], ["plain.map"], ["--forget", "."], [".", "--list"]])
def test_what_cannot_be_trusted_is_one_line(folder, capsys, arguments):
    assert main(["trust", *arguments]) == 2
    refusal(capsys, folder)


def test_list_that_cannot_be_written_is_one_line(folder, capsys, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "file"))
    assert main(["trust", "."]) == 2
    assert f"{tmp_path / 'file' / 'mrp-sumo' / 'trusted'}: cannot be written" in capsys.readouterr().err


@pytest.mark.slow
def test_call_in_python_names_a_program_and_a_file_does_not(folder):
    with pytest.raises(ms.MrpSumoError, match="would run"):
        ms.run(ms.Scenario.read("planner.yaml"))
    with pytest.raises(ms.MrpSumoError, match="would run"):
        ms.run_suite("suite_planner.yaml", "out", workers=1)
    assert not (folder / "RAN").exists()
    problem = ms.problem(ms.Scenario(map="office", robots=2))
    assert ms.plan(problem, "planner.py:Mine").plan is not None
    (folder / "RAN").unlink()
    ms.plan(ms.problem(ms.Scenario.read("planner.yaml", trust=True)))
    assert (folder / "RAN").exists()


@pytest.mark.slow
def test_suite_trusted_in_python_is_trusted_for_its_batch_only(folder):
    assert ms.run_suite("suite_planner.yaml", "out", workers=1, trust=True).counts == {"planned": 2}
    with pytest.raises(ms.MrpSumoError, match="would run"):
        ms.run_suite("suite_command.yaml", "other", workers=1)


def test_new_process_trusts_nothing(folder):
    environment = {**os.environ, "XDG_CONFIG_HOME": str(folder.parent / "config")}
    ended = subprocess.run([sys.executable, "-m", "mrp_sumo", "plan", "planner.yaml"], capture_output=True, text=True, env=environment)
    assert ended.returncode == 2 and ended.stderr.startswith("mrp-sumo: planner.yaml:5: planner.name: would run ")
