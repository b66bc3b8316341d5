"""`mrp-sumo run`, from the command line to the run folder, on the bundled maps."""

import hashlib
import json
from pathlib import Path

import pytest

from mrp_sumo.cli.main import main
from mrp_sumo.metrics.registry import MACHINE_DEPENDENT

METRICS = [
    "plan_success",
    "plan_valid",
    "planning_time_s",
    "assignment_time_s",
    "makespan_steps",
    "cost_steps",
    "soc_steps",
    "lower_bound_steps",
    "num_robots",
    "goals_reached",
    "all_goals_reached",
    "execution_time_s",
    "execution_timed_out",
    "min_distance_m",
    "min_distance_at_start_m",
    "min_distance_delta_m",
    "time_blocked_total_s",
    "time_blocked_s",
    "min_clearance_m",
    "num_overlaps",
    "lateness_mean_s",
    "lateness_p95_s",
    "lateness_max_s",
    "sim_time_s",
    "wall_time_s",
    "cpu_time_s",
    "real_time_factor",
    "robot_seconds_per_cpu_second",
]


def run(out, *arguments):
    code = main(["run", *arguments, "--out", str(out)])
    return code, json.loads((out / "result.json").read_text()) if (out / "result.json").exists() else None


def digests(folder):
    return {p.relative_to(folder).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.rglob("*") if p.is_file()}


@pytest.fixture(scope="module")
def office(tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "office"
    return out, *run(out, "office_5")


def test_run_reaches_all_goals_and_says_so(office):
    _, code, result = office
    assert code == 0
    assert result["status"] == "completed"
    assert result["metrics"]["goals_reached"] == result["metrics"]["num_robots"] == 5
    assert result["audit"]["passed"]


def test_run_folder_is_complete(office):
    out, _, result = office
    assert set(METRICS) <= set(result["metrics"])
    assert {"status", "scenario", "seed", "versions", "metrics", "audit", "files"} <= set(result)
    for name in ("plan.json", "trajectory.parquet", "events.jsonl", "network.net.xml", "bag"):
        assert (out / name).exists(), name
    assert result["seed"] == 3000
    assert len(result["metrics"]["time_blocked_s"]) == 5


def test_paper_counts_and_standard_counts_agree(office):
    metrics = office[2]["metrics"]
    assert metrics["cost_steps"] == metrics["soc_steps"] + metrics["num_robots"]
    assert metrics["lower_bound_steps"] <= metrics["soc_steps"]


def test_same_seed_gives_the_same_bytes(office, tmp_path):
    out, _, first = office
    _, second = run(tmp_path / "again", "office_5")
    same = [name for name in first["metrics"] if name not in MACHINE_DEPENDENT]
    assert {name: first["metrics"][name] for name in same} == {name: second["metrics"][name] for name in same}
    before, after = digests(out), digests(tmp_path / "again")
    renamed = {name.replace("again", out.name): digest for name, digest in after.items()}
    differing = {name for name in before if before[name] != renamed.get(name)} | (set(renamed) - set(before))
    assert differing <= {"result.json"}


def test_other_seed_gives_another_run(office, tmp_path):
    _, result = run(tmp_path / "other", "office_5", "--seed", "1")
    assert result["seed"] == 1
    assert result["metrics"]["min_distance_at_start_m"] != office[2]["metrics"]["min_distance_at_start_m"]


def test_uncoordinated_plan_is_labelled_and_still_driven(tmp_path, capsys):
    code, result = run(tmp_path / "out", "warehouse_9", "--planner", "astar")
    assert result["metrics"]["plan_valid"] is False
    assert result["policy"] == "open_loop"
    assert "plan has conflicts" in capsys.readouterr().out
    assert code == (0 if result["metrics"]["all_goals_reached"] and result["status"] == "completed" else 1)


def test_time_limit_that_is_too_short_is_a_result_not_an_error(tmp_path):
    scenario = tmp_path / "short.yaml"
    scenario.write_text("map: office\nrobots: {count: 3}\nplanner: astar\nexecution: {time_limit_s: 5}\n")
    code, result = run(tmp_path / "out", str(scenario))
    assert (code, result["status"]) == (1, "time_limit")
    assert result["metrics"]["execution_timed_out"] is True


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("map: ofice\nrobots: {count: 3}", "case.yaml:1: map: no map 'ofice': neither a file nor a bundled map (did you mean 'office'?)"),
        ("map: office\nrobots: {count: 3}\nplanner: cbz", "case.yaml:3: planner.name: unknown planner 'cbz' (did you mean 'cbs'?)"),
        (
            "map: office\nrobots: {count: 3}\nplanner: {name: cbs, parameters: {bypas: true}}",
            "case.yaml:3: planner.parameters: planner 'cbs': unknown parameter 'bypas' (did you mean 'bypass'?)",
        ),
        ("map: office\nrobots: {count: 400}", "case.yaml:2: robots.count: 400 robots, but 'office' has 29 stations"),
        ("map: office\nrobots: {count: 30, draw: mrp_bench}", "case.yaml:2: robots.count: cannot draw 30 robots: there are 29 vertices"),
        ("map: office\nrobots: {starts: [nowhere], goals: [v3]}", "case.yaml:2: robots.starts[0]: 'nowhere' is not a vertex of 'office'"),
        ("map: office\nrobots: {starts: [v1, v1], goals: [v3, v4]}", "robot_0 and robot_1 both start at"),
        ("map: office\nrobots: {starts: [v1, v2], goals: [v3, v3]}", "robots.goals[1]: 'v3' is the goal of two robots"),
        (
            "map: office\nrobots: {count: 3}\nexecution: {policy: agd}",
            "case.yaml:3: execution.policy: unknown execution policy 'agd' (did you mean 'adg'?)",
        ),
        (
            "map: office\nrobots: {count: 3}\nexecution: {step_length_s: 0.3}",
            "case.yaml:3: execution.step_length_s: a sample every 0.1 s, expected a whole number of steps of 0.3 s",
        ),
        (
            "map: office\nrobots: {count: 3}\nexecution: {policy: adg}\nrecord: {period_s: 0.25}",
            "case.yaml:4: record.period_s: a sample every 0.25 s, expected a whole number of steps of 0.1 s",
        ),
        ("map: {file: office, graph: 4}\nrobots: {count: 3}", "office.building.yaml has no lane in graph 4"),
        ("map: {file: office, level: L7}\nrobots: {count: 3}", "has no level 'L7'"),
        ("map: office\nrobots: {count: 3}\ndiscretisation: {kind: grid, cell_m: 0.2}", "'turtlebot3' does not fit"),
        (
            "map: office\nrobots: {count: 3, start_heading_deg: [90, north, 0]}",
            "case.yaml:2: robots.start_heading_deg: found 'north', expected degrees from -360 to 360, or a list of them",
        ),
        (
            "map: office\nrobots: {count: 3, goal_heading_deg: [90]}",
            "case.yaml:2: robots: goal_heading_deg has 1 headings, but there are 3 goals",
        ),
        (
            "map: office\nrobots: {starts: [lobby], goals: [reception], goal_heading_deg: 45}",
            "robots.goal_heading_deg: found 45, but no lane leads to 'reception' or away from it in that heading, expected one of 90, 270",
        ),
        (
            "map: office\nrobots: {count: 3, type: {length_m: 0.1, width_m: 0.1, max_speed_mps: 2, accel_mps2: 1, decel_mps2: 0.01, "
            "turn_rate_rad_s: 1}}",
            "robots.type: 'custom' cannot stop: from 2 m/s at 0.01 m/s2 it takes 200 m, and 'office' is",
        ),
        ("map: office\nrobots: {count: 3, type: forklift}\ndiscretisation: roadmap", "lane 'lobby' - "),
        ("map: office\nrobots: {count: 3, type: turtlebot}", "robots.type: 'turtlebot' is neither a robot type nor a file"),
        (
            "map: office\nrobots: {count: 3}\nrecord: {robots: [robot_3]}",
            "record.robots[0]: 'robot_3' is not a robot (did you mean",
        ),
        ("map: office\nrobots: {count: 3}\nassignment: {solver: lsa}", "assignment.solver: unknown assigner 'lsa'"),
    ],
)
def test_bad_input_is_one_line_exit_2_and_nothing_written(tmp_path, capsys, text, words):
    scenario = tmp_path / "case.yaml"
    scenario.write_text(text)
    code, _ = run(tmp_path / "out", str(scenario))
    output = capsys.readouterr().err
    assert code == 2
    assert words in output
    assert len(output.splitlines()) == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["case.yaml"]


def test_folder_that_is_no_run_is_never_replaced(tmp_path, capsys):
    (tmp_path / "thesis.txt").write_text("three years of work")
    assert main(["run", "office_5", "--out", str(tmp_path)]) == 2
    assert (tmp_path / "thesis.txt").read_text() == "three years of work"
    assert str(tmp_path) in capsys.readouterr().err


def test_table_has_what_a_person_asks_for(office, tmp_path, capsys):
    run(tmp_path / "out", "office_5")
    output = capsys.readouterr().out
    for words in (
        "planner",
        "planning time",
        "makespan",
        "cost",
        "lower bound",
        "goals reached",
        "5 of 5",
        "minimum distance",
        "blocked time",
        "real-time factor",
        "files",
    ):
        assert words in output, words


def test_schema_is_json(capsys):
    assert main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out)["title"] == "Scenario"


def test_unknown_command_names_the_nearest(capsys):
    assert main(["imprt"]) == 2
    assert capsys.readouterr().err == "mrp-sumo: unknown command 'imprt' (did you mean 'import'?)\n"


def test_help_of_a_command_is_its_own(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["help", "trust"])
    assert ended.value.code == 0 and capsys.readouterr().out.startswith("usage: mrp-sumo trust ")


def test_file_without_a_command_is_told_what_it_lacks(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("my plant.xml").touch()
    assert main(["my plant.xml"]) == 2
    assert capsys.readouterr().err == "mrp-sumo: expected a command before 'my plant.xml', such as `mrp-sumo run 'my plant.xml'`\n"


def test_robots_choose_among_more_goals_than_there_are_robots(tmp_path):
    scenario = tmp_path / "choice.yaml"
    scenario.write_text("map: office\nrobots: {starts: [v1], goals: [v20, v2, v3]}\nplanner: astar\nassignment: {cost: path}\n")
    code, result = run(tmp_path / "out", str(scenario))
    assert code == 0
    assert result["robots"][0]["goal"] != ""
    assert result["metrics"]["soc_steps"] == min(
        run(tmp_path / f"out{goal}", str(_fixed(tmp_path, goal)))[1]["metrics"]["soc_steps"] for goal in ("v20", "v2", "v3")
    )


def _fixed(folder, goal):
    path = folder / f"{goal}.yaml"
    path.write_text(f"map: office\nrobots: {{starts: [v1], goals: [{goal}]}}\nplanner: astar\nassignment: {{mode: fixed}}\n")
    return path


def test_a_run_through_a_wall_fails_its_audit_and_says_where(tmp_path):
    wide = ["office_9", "--set", "discretisation.cell_m=1.0", "--set", "record.bag=false"]
    code, result = run(tmp_path / "through", *wide)
    assert code == 1 and result["status"] == "audit_failed" and result["metrics"]["all_goals_reached"]
    assert "drives through a wall at (" in result["note"]
    assert result["metrics"]["num_wall_contacts"] > 0 and result["metrics"]["min_wall_clearance_m"] == 0
    code, result = run(tmp_path / "around", *wide, "--set", "discretisation.clearance=prune")
    assert code == 0 and result["status"] == "completed"
    assert "lanes lead through a wall" in result["note"]  # which are left out
    assert result["metrics"]["num_wall_contacts"] == 0 < result["metrics"]["min_wall_clearance_m"]


def test_a_plan_file_is_driven_in_the_coordinates_of_its_map(tmp_path):
    (tmp_path / "hall.map").write_text("type octile\nheight 4\nwidth 6\nmap\n@@@@@@\n@....@\n@....@\n@@@@@@\n")
    (tmp_path / "plan.txt").write_text("Agent 0: (1,1)->(1,2)->(1,3)->(1,4)->\nAgent 1: (2,4)->(2,3)->(2,2)->(2,1)->\n")
    (tmp_path / "cropped.txt").write_text("Agent 0: (0,0)->(0,1)->(0,2)->(0,3)->\nAgent 1: (1,3)->(1,2)->(1,1)->(1,0)->\n")
    on_map = ["--map", str(tmp_path / "hall.map"), "--set", "execution.engine=kinematic"]
    code, result = run(tmp_path / "run", *on_map, "--plan", str(tmp_path / "plan.txt"))
    assert (code, result["status"], result["scenario"]["planner"]["name"]) == (0, "completed", "plan_file")
    assert result["metrics"]["soc_steps"] == 6
    (tmp_path / "hall.scen").write_text(
        "version 1\n0\thall.map\t6\t4\t1\t1\t4\t1\t3\n0\thall.map\t6\t4\t4\t2\t1\t2\t3\n0\thall.map\t6\t4\t2\t1\t3\t2\t2\n"
    )
    code, shifted = run(tmp_path / "shifted", *on_map, "--scen", str(tmp_path / "hall.scen"), "--plan", str(tmp_path / "cropped.txt"))
    assert (code, shifted["metrics"]["driven_makespan_s"]) == (0, result["metrics"]["driven_makespan_s"])
    assert "+1 columns and +1 rows" in shifted["note"]


def test_a_plan_file_may_have_times_of_real_motion(office, tmp_path):
    folder, _, result = office
    code, again = run(tmp_path / "again", "office_5", "--plan", str(folder / "plan.json"), "--set", "record.bag=false")
    assert code == 0
    assert again["metrics"]["driven_flowtime_s"] == result["metrics"]["driven_flowtime_s"]


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["office_5", "--plan", "FOLDER/none.txt"], "no such file"),
        (["office_9", "--plan", "FOLDER/plan.json"], "is not in both the plan and the fleet"),
        (["office_5", "--seed", "4", "--plan", "FOLDER/plan.json"], "plan.json: no plan for this problem: robot_0 begins at"),
        (["warehouse_5", "--plan", "FOLDER/plan.json"], "plan.json: "),
        (["office_5", "--plan", "FOLDER/plan.json", "--planner", "cbs"], "--plan is a plan that is there already"),
        (["--map", "FOLDER/none.map"], "no starts and goals, expected --scen, or --plan"),
        (["office_5", "--scen", "FOLDER/none.scen"], "--scen is for --map"),
        ([], "expected either a scenario or map file, or --map"),
    ],
)
def test_a_plan_for_something_else_is_one_line(office, tmp_path, capsys, arguments, line):
    folder, _, _ = office
    code, _ = run(tmp_path / "run", *(argument.replace("FOLDER", str(folder)) for argument in arguments))
    said = capsys.readouterr().err
    assert (code, said.count("\n"), (tmp_path / "run").exists()) == (2, 1, False)
    assert line in said


def test_headings_of_starts_and_goals_are_planned_driven_and_kept_in_the_plan(tmp_path, capsys):
    scenario = tmp_path / "facing.yaml"
    scenario.write_text(
        "map: office\nrobots: {starts: [lobby, reception], goals: [reception, lobby], start_heading_deg: [180, null], "
        "goal_heading_deg: 90}\n"
        "planner: {name: lacam}\nassignment: {mode: fixed}\nexecution: {engine: kinematic}\nrecord: {bag: false}\n"
    )
    code, result = run(tmp_path / "out", str(scenario))
    metrics = result["metrics"]
    assert code == 0 and metrics["driven_flowtime_s"] == pytest.approx(metrics["flowtime_s"])
    path = tmp_path / "out" / "plan.json"
    plan = json.loads(path.read_text())
    assert [robot["start_heading_rad"] for robot in plan["robots"]] == [pytest.approx(3.14159265), None]
    assert sum(robot["turned_s"] for robot in plan["robots"]) == pytest.approx(metrics["flowtime_s"])
    verdicts = []
    for shorter_s in (0.0, 0.3):
        for robot in plan["robots"]:
            robot["turned_s"] -= shorter_s
        path.write_text(json.dumps(plan))
        main(["validate", str(path), "--scenario", str(scenario)])
        verdicts.append(capsys.readouterr().out)
    assert "\ndrivable: " in verdicts[0]
    assert "cannot have turned there by" in verdicts[1]


def test_run_as_json_is_one_line_that_names_its_folder(tmp_path, capsys):
    assert main(["run", "office_5", "--planner", "prioritised", "--json", "--out", str(tmp_path / "run")]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["status"] == "completed" and said["folder"] == str(tmp_path / "run")
    assert said["metrics"] == json.loads((tmp_path / "run" / "result.json").read_text())["metrics"]


def test_command_after_a_timeout_says_another_planner_and_limit_also_where_set_said_them(tmp_path, capsys):
    out = str(tmp_path / "out")
    line = ["run", "office_9", "--set", "planner.time_limit_s=0.000001", "--set=planner.name=lacam", "--set", "seed=1", "--out", out]
    assert main(line) == 1
    assert capsys.readouterr().out.partition("next: ")[2].splitlines() == [
        f"mrp-sumo run office_9 --set planner.time_limit_s=0.000001 --set seed=1 --out {out} --planner auto",
        f"      mrp-sumo run office_9 --set planner.name=lacam --set seed=1 --out {out} --time-limit 300",
        "      mrp-sumo list planners",
    ]


def test_options_with_a_name_and_set_are_one_change(tmp_path):
    case = tmp_path / "case.yaml"
    case.write_text("map: office\nrobots: {starts: [v1, v2], goals: [v3, v4]}\nplanner: prioritised\n")
    more = ("--robots", "3", "--set", "robots.starts=null", "--set", "robots.goals=null")  # which two starts alone would refuse
    code, result = run(tmp_path / "run", str(case), *more, "--planner", "eecbs", "--set", "w=1.5")
    assert code == 0 and result["metrics"]["num_robots"] == 3 and result["scenario"]["planner"]["parameters"] == {"w": 1.5}
