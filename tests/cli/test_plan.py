"""`mrp-sumo plan`, `validate`, and `convert` for plans."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from mrp_sumo.cli.main import main

MAP = "type octile\nheight 2\nwidth 3\nmap\n...\n.@.\n"
SCEN = "version 1\n0\tu.map\t3\t2\t0\t1\t2\t1\t4\n0\tu.map\t3\t2\t2\t0\t0\t0\t2\n"


@pytest.fixture
def files(tmp_path):
    (tmp_path / "u.map").write_text(MAP)
    (tmp_path / "u.scen").write_text(SCEN.replace("2\t0\t0\t0", "2\t0\t1\t0").replace("0\t1\t2\t1", "0\t1\t0\t0"))
    return ["--map", str(tmp_path / "u.map"), "--scen", str(tmp_path / "u.scen")]


def test_plan_is_found_written_validated_and_converted(files, tmp_path, capsys):
    out = tmp_path / "plan.json"
    assert main(["plan", *files, "--planner", "lacam", "--time-limit", "10", "--out", str(out), "--json"]) == 0
    output = json.loads(capsys.readouterr().out)
    assert (output["status"], output["valid"], output["robots"], output["cost"], output["lower_bound"]) == ("solved", True, 2, 2, 2)
    assert main(["validate", str(out), *files]) == 0
    assert "valid: 2 robots, sum of costs 2" in capsys.readouterr().out
    for kind in ("yaml", "paths", "lacam", "smart"):
        other, back = tmp_path / f"{kind}.out", tmp_path / f"{kind}.json"
        assert main(["convert", str(out), str(other), "--format", kind, "--map", files[1]]) == 0
        assert main(["validate", str(other), *files]) == 0
        assert main(["convert", str(other), str(back), "--map", files[1]]) == 0
        assert json.loads(back.read_text())["robots"] == json.loads(out.read_text())["robots"]
    assert main(["convert", str(tmp_path / "smart.out"), str(tmp_path / "cells.txt")]) == 0
    assert (tmp_path / "cells.txt").read_text() == (tmp_path / "paths.out").read_text()


def test_invalid_plan_ends_with_its_first_conflicts(files, tmp_path, capsys):
    plan = tmp_path / "plan.txt"
    plan.write_text("Agent 0: (1,0)->(0,0)->(0,1)->(0,0)->\nAgent 1: (0,2)->(0,2)->(0,1)->\n")
    assert main(["validate", str(plan), *files]) == 1
    assert capsys.readouterr().out.splitlines()[0].startswith("robot_0 and robot_1 meet at")
    plan.write_text("Agent 0: (1,0)->(0,1)->(0,0)->\nAgent 1: (0,2)->(0,1)->\n")
    assert main(["validate", str(plan), *files, "--json"]) == 1
    output = json.loads(capsys.readouterr().out)
    assert not output["valid"]
    assert "robot_0 jumps" in output["faults"][0]


def test_no_plan_is_exit_code_one(files, tmp_path, capsys):
    (tmp_path / "u.map").write_text(MAP.replace("...", ".@."))
    (tmp_path / "u.scen").write_text("version 1\n0\tu.map\t3\t2\t0\t1\t2\t1\t4\n")
    assert main(["plan", *files, "--out", str(tmp_path / "p.json"), "--json"]) == 1
    output = json.loads(capsys.readouterr().out)
    assert output["status"] == "infeasible"
    assert "robot_0 cannot reach its goal" in output["message"]
    assert not (tmp_path / "p.json").exists()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["plan"], "expected either a scenario or --map"),
        (["plan", "FILES", "--time-limit", "-1"], "--time-limit is -1"),
        (["plan", "FILES", "--time-limit", "nan"], "--time-limit is nan"),
        (["plan", "FILES", "--robots", "3"], "has 2 robots, 3 are wanted"),
        (["plan", "FILES", "--seed", "-1"], "the seed is -1"),
        (["plan", "FILES", "--assignment", "mop"], "unknown assigner 'mop'"),
        (["plan", "office_5", "--assignment", "mip"], "--scen and --assignment are for --map"),
        (["plan", "FILES", "--planner", "lacan"], "did you mean 'lacam'"),
        (["plan", "FILES", "--set", "anytme=true"], "did you mean 'anytime'"),
        (["plan", "FILES", "--set", "scatter"], "expected KEY=VALUE"),
        (["plan", "FILES", "--command", "solve {map}"], "no {out}"),
        (["plan", "FILES", "--out", "plan.xyz"], "no plan format ends in '.xyz'"),
        (["validate", "/no/such/plan", "FILES"], "no such file"),
        (["validate", "MAP", "FILES"], "not a plan in a known format"),
    ],
)
def test_bad_input_ends_with_one_line(files, arguments, says, capsys):
    words = [word for a in arguments for word in ({"FILES": files, "MAP": files[1:2]}.get(a, [a]))]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1


VISITS = '{"vertex": 0, "arrive_s": 0, "depart_s": 0}, {"vertex": 1, "arrive_s": 1, "depart_s": null}'


@pytest.mark.parametrize(
    ("visits", "says"),
    [
        (VISITS.replace('"vertex": 1', '"vertex": "dock"'), "robots[0].visits[1] has the vertex 'dock', expected a vertex's number"),
        (VISITS.replace('"vertex": 1', '"vertex": 1.5'), "has the vertex 1.5"),
        (VISITS.replace('"vertex": 1', '"vertex": 1' + 30 * "0"), "expected a vertex's number"),
        (VISITS.replace('"arrive_s": 1', '"arrive_s": null'), "has the arrive_s None, expected a time in s"),
        (VISITS.replace(', "depart_s": null', ""), "has the depart_s 'missing'"),
        ("7", "robots[0].visits[0] is 7, expected a visit"),
        (VISITS.replace('"depart_s": 0', '"depart_s": null'), "robot 0 has a visit without a time"),
        (VISITS.replace('"arrive_s": 0', '"arrive_s": -1'), "robot 0 has no visit at 0 s"),
        (VISITS.replace('"vertex": 1', '"vertex": -1'), "vertex -1 is not on u.map"),
        (VISITS.replace('"vertex": 1', '"vertex": 77'), "vertex 77 is not on u.map"),
    ],
)
def test_damaged_plan_files_are_told_in_one_line(files, tmp_path, visits, says, capsys):
    plan = tmp_path / "plan.json"
    plan.write_text('{"schema_version": 1, "step_s": 1.0, "robots": [{"name": "robot_0", "visits": [' + visits + "]}]}")
    assert main(["convert", str(plan), str(tmp_path / "out.yaml"), "--map", files[1]]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1
    assert main(["validate", str(plan), *files]) in (1, 2)


def test_plan_for_no_robots_is_valid_only_where_that_is_meant(files, tmp_path, capsys):
    plan = tmp_path / "plan.yaml"
    plan.write_text("schedule: {}\n")
    assert main(["validate", str(plan), *files]) == 2
    assert "a plan for no robots: say --robots 0" in capsys.readouterr().err
    assert main(["validate", str(plan), *files, "--robots", "0"]) == 0


def test_a_list_is_planned_in_one_process_and_a_refused_line_stops_nothing(files, tmp_path, capsys):
    out, listed = tmp_path / "plan.json", tmp_path / "list.txt"
    instance = " ".join(files)
    listed.write_text(
        f"# two, and one that is not there\n{instance} --out {out}\n\n{instance} --scen none.scen\n{instance} --planner cbs\n"
    )
    assert main(["plan", "--many", str(listed), "--planner", "lacam", "--time-limit", "10", "--json"]) == 2
    first, second, third = map(json.loads, capsys.readouterr().out.splitlines())
    assert (first["planner"], first["valid"], third["planner"], third["cost"]) == ("lacam", True, "cbs", 2)
    assert first["line"].endswith(":2") and first["planning_cpu_s"] > 0 and json.loads(out.read_text())["robots"]
    assert second["status"] == "refused" and "none.scen" in second["message"]


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("office_9 --trust", "names a program to run"),
        ("office_9 --command 'rm {map}'", "names a program to run"),
        ("office_9 --planner ./mine.py:Mine", "names a program to run"),
        ("office_9 --set planner.parameters.command=ls", "names a program to run"),
        ("office_9 --speed", "unrecognized arguments: --speed"),
        ("--robots 3", "expected either a scenario or --map"),
    ],
)
def test_a_line_that_cannot_be_planned_is_refused_before_anything_is(line, says, tmp_path, capsys):
    (tmp_path / "list.txt").write_text(f"office_9\n{line}\n")
    assert main(["plan", "--many", str(tmp_path / "list.txt")]) == 2
    said = capsys.readouterr()
    assert said.out == "" and "list.txt:2: " in said.err and says in said.err and said.err.count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "unneeded"),
    [
        (["office_5", "--planner", "eecbs"], "pandas libsumo mrp_sumo.metrics mrp_sumo.drive.dispatcher"),
        (["files"], "pandas libsumo mrp_sumo.metrics mrp_sumo.drive pydantic ortools"),
    ],
)
def test_plan_loads_only_what_it_needs(files, arguments, unneeded):
    params = files if arguments == ["files"] else arguments
    code = f"from mrp_sumo.cli.main import main; main(['plan', *{params!r}]); import sys; print(*sys.modules)"
    for _ in range(2):  # the first may have to compile
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2])
    loaded = done.stdout.splitlines()[-1].split()
    assert "mrp_sumo.cli.plan" in loaded and not set(unneeded.split()) & set(loaded)
