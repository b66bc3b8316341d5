"""Options that have no effect beside the others, or values out of range, are refused in one line: nothing is ignored in silence."""

import os
import re
import shlex

import pytest

from mrp_sumo.cli.main import main
from mrp_sumo.files.folders import PLAN, RESULT

SUITE = "name: few\nbase: {map: office, robots: 2}\ngrid_search: {seed: 0..1}\n"
CASES = (
    ("import office --check --graph 7", "office.building.yaml has no lane in graph 7; graphs with lanes: 0 (32 lanes)"),
    ("import office --check --level L9", "office.building.yaml has no level 'L9' (known: L1)"),
    ("import office --check --snap -1", "--snap: found -1, expected more than 0; see `mrp-sumo import --help`"),
    ("import office --check --cell nan", "--cell: found nan, expected more than 0; see `mrp-sumo import --help`"),
    ("import office --check --join-short x", "--join-short: found 'x', expected a number; see `mrp-sumo import --help`"),
    (
        "import office --check --robot-radius 0.3",
        "office.building.yaml: --robot-radius is for occupancy maps and plans of a floor; --robot tells where it has no room",
    ),
    ("import office --check --unit mm", "office.building.yaml: this kind of map has no unit to choose"),
    ("import office --check --out new", "--check writes nothing: leave out --out"),
    ("import office --check --map office", "--map is for a recorded stream, FILE.jsonl"),
    ("convert office new.nav.yaml --format json", "--format is for plans"),
    ("convert paths.txt new.yaml --graph 0", "--graph is for maps"),
    ("export one --csv --robots nobody", "--robots is for bags: --bag, --ros1"),
    ("export one --geojson --repeat-latched 5", "--repeat-latched is for bags: --bag, --ros1"),
    ("export one --vda5050 --poses", "--poses is for bags: --bag, --ros1"),
    ("export one --ros1 --storage mcap", "--storage is for ROS 2 bags: --bag"),
    ("export one --bag --split nan", "--split: found nan, expected seconds of 0 or more"),
    ("capacity warehouse_lifelong --dry-run --json", "--json is for an answer: leave it out with --dry-run"),
    ("query . --csv", "{here}: not the folder of a batch: there is no plan.json"),
    ("compare few one", "one: a run, expected a batch; `mrp-sumo analyze` and `mrp-sumo report` measure and show a run"),
    ("report .", "{here}: neither a batch nor a run: there is no plan.json and no result.json"),
    ("reproduce few", "few: holds no complete run (no result.json)"),
    ("replay few", "few: holds no complete run (no result.json)"),
    ("status few --live --json", "--live shows the batch in a browser: leave out --json"),
    ("reproduce one --base nowhere", "--base nowhere: no such folder"),
    ("analyze . --metric makespan_s --cell 0.5", "--cell is for MRP-Bench's metrics, without --metric and --audit"),
    ("analyze . --audit --config few.yaml", "--config is for MRP-Bench's metrics, without --metric and --audit"),
    ("run office_5 --plan paths.txt --time-limit 3", "--plan is a plan that is there already: leave out --time-limit"),
    (
        "run office_5 --plan paths.txt --set planner.time_limit_s=3",
        "--plan is a plan that is there already: leave out --set of the planner",
    ),
    ("run office_5 --command ''", "--command: found nothing, expected a command line, such as 'lacam3 -m {map} -i {scen} -o {out}'"),
    (
        "run office_5 --set execution.nope=1",
        "--set execution.nope: unknown key (known: engine, planning, step_length_s, blocking_window_s, on_deadlock, recovery, "
        "disturbances, policy, dispatcher, invalid_plan, time_limit_s, goal_tolerance_m, mutex_groups, one_way, doors, manual_doors)",
    ),
    ("run office_5 --live --port 99999", "--port: found '99999', expected a whole number up to 65535"),
    ("run paths.json", "paths.json: a plan of this program: `mrp-sumo run SCENARIO --plan FILE` drives it"),
    ("plan office", "office: no scenario, expected a file with `map` and `robots`; `mrp-sumo init` writes one for a map"),
    ("capacity room.map", "room.map: no scenario, expected a file with `map` and `robots`; `mrp-sumo init` writes one for a map"),
    ("capacity warehouse_lifelong --out room.map", "room.map: is a file, expected a folder for the study"),
    (
        "capacity warehouse_lifelong --dry-run --what-if ''",
        "--what-if: found nothing, expected a key and a value, such as 'planner: lacam' or 'stations.pack: +1'",
    ),
    ("batch few.yaml --out one", "one: a run, expected a batch; `mrp-sumo analyze` and `mrp-sumo report` measure and show a run"),
    ("batch few.yaml --out room.map", "room.map is not a folder; give another --out"),
    (
        "plan --many nothing.txt",
        "--many nothing.txt: found nothing, expected a line for each plan, such as '--map room.map --scen few.scen'",
    ),
    ("demo --out .", "--out .: holds 'few', which is not of a demo; give another folder"),
    (
        "run office_5 --engine kinematic",
        "unrecognized arguments: --engine kinematic; other keys of the scenario: --set KEY=VALUE; see `mrp-sumo run --help`",
    ),
    ("run office_5 --robot_s 3", "unrecognized arguments: --robot_s 3 (did you mean '--robots'?); see `mrp-sumo run --help`"),
    ("convert room.map ./room.map", "room.map: is what is converted, expected another file to write"),
    ("office_5", "expected a command before 'office_5', such as `mrp-sumo run office_5`"),
    ("--robots 3 run office_5", "expected a command before --robots, such as `mrp-sumo run office_9 --robots`"),
    ("run office_5 --set 'robots={count: x}'", "--set robots: count: found 'x', expected a whole number"),
    ("run few.yaml", "few.yaml: a suite, expected a scenario, with `map` and `robots`; see `mrp-sumo batch`"),
    ("plan one/copy.json", "one/copy.json: the result of a run, expected a scenario; `mrp-sumo reproduce` makes the run again"),
    ("run one/keys.yaml", "keys.yaml:3: 3: found 3 as a key, expected a text, in quotes if it looks like something else"),
    ("plan office_5 --set map=", "--set map: found nothing, expected a map's name or file, or keys and values"),
    ("plan office_5 --json=1", "--json: found '1', expected nothing after it; see `mrp-sumo plan --help`"),
    ("plan office_5 --out ''", "'.': no plan format ends in '' (known: .json, .yaml, .yml, .txt); or choose --format"),
    ("status nobatch", "nobatch/plan.json: not the plan of a batch"),
    ("plan office_5 --steps 5", "--steps is for problems of the League of Robot Runners (.json)"),
    ("plan office_5 --format json", "--format is for --out"),
    ("validate paths.txt --scenario office_5 --scen few.scen", "--scen is for --map"),
    ("validate --vda5050 few.yaml --robots 3", "--robots is for plans"),
    ("validate --vda5050 few.yaml --limit -1", "--limit: found -1, expected 0 or more"),
    ("batch few.yaml --verbose", "--verbose is for --dry-run"),
    ("batch few.yaml --dry-run --json", "--dry-run runs nothing, and --json prints how runs ended: leave out one of the two"),
    ("batch few.yaml --dry-run --metric nope", "unknown metric 'nope'; `mrp-sumo list metrics` names them all"),
    (
        "batch few.yaml --workers 2 --scheduler localhost:1",
        "--workers is for this machine: a Dask scheduler has workers of its own; leave out one of the two",
    ),
    ("batch small.yaml", "small.yaml: a scenario, expected a suite, with `base` and `grid_search`; see `mrp-sumo run`"),
    ("replay one --port 8000", "--port is for --serve"),
    ("replay one --out page.txt", "--out page.txt: a page for a browser, expected a name that ends in .html"),
    ("render one --at 5 --out new.png --from 0", "--from is for --video"),
    ("render one --at 5 --out new.png --robots robot_0", "--robots is for --video"),
    ("render one --at 5 --out new.svg --dpi 300", "--dpi is for PNG files: an SVG has no pixels"),
    ("render one --at -1 --out new.png", "--at -1: is outside the run, which begins at 0 s"),
    ("render one --video new.gif --from nan", "--from nan: is outside the run, which begins at 0 s"),
    ("run office_5 --rerun new.txt", "--rerun new.txt: expected a file that ends with .rrd, or rerun+http://HOST:PORT/proxy"),
    ("vda5050 office_5 --broker localhost:1 --planner cbss", "--planner: unknown planner 'cbss' (did you mean 'cbs'?)"),
    ("render one --video new.gif --dpi 100", "--dpi is for a picture; a video has --size"),
)


@pytest.mark.parametrize(("words", "line"), CASES)
def test_option_without_effect_is_refused_in_a_line(tmp_path, monkeypatch, capsys, words, line):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "few.yaml").write_text(SUITE)
    (tmp_path / "small.yaml").write_text("map: office\nrobots: 2\n")
    (tmp_path / "paths.txt").write_text("Agent 0: (0,0)->(0,1)->\n")
    for folder, file in (("one", RESULT), ("few", PLAN)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / file).write_text("{}")
    (tmp_path / "one" / "copy.json").write_text('{"status": "done", "robots": [], "metrics": {},\n"scenario": {\n"map": {}}}')
    (tmp_path / "one" / "keys.yaml").write_text("map: office\nrobots: 2\n3: x\n")
    (tmp_path / "one" / PLAN).write_text("{}")
    (tmp_path / "nothing.txt").write_text("\n\n")
    (tmp_path / "nobatch").mkdir()
    (tmp_path / "nobatch" / PLAN).write_text('{"robots": []}')
    (tmp_path / "paths.json").write_text('{"schema_version": 1, "step_s": 1.0, "units": "m, s", "robots": []}')
    (tmp_path / "room.map").write_text("type octile\nheight 1\nwidth 2\nmap\n..\n")
    before = sorted(tmp_path.rglob("*"))
    assert main(shlex.split(words)) == 2
    assert capsys.readouterr() == ("", f"mrp-sumo: {line.replace('{here}', '.')}\n")
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("command", ["batch few.yaml", "capacity warehouse_lifelong", "paper"])
def test_more_processes_than_the_machine_bears_are_refused(tmp_path, monkeypatch, capsys, command):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "few.yaml").write_text(SUITE)
    assert main([*command.split(), "--workers", "100000"]) == 2
    most = 8 * len(os.sched_getaffinity(0))
    assert capsys.readouterr().err == f"mrp-sumo: --workers: found 100000, expected 1 to {most}, 8 for each core\n"


@pytest.mark.parametrize("command", ["query", "status"])
def test_run_in_place_of_a_batch_is_called_a_run(tmp_path, capsys, command):
    for name in ("plan.json", "result.json"):
        (tmp_path / name).write_text("{}")
    assert main([command, str(tmp_path)]) == 2
    assert re.fullmatch(r"mrp-sumo: .*: a run, expected a batch; `mrp-sumo analyze` and .*\n", capsys.readouterr().err)


def test_check_looks_at_the_repaired_map(tmp_path, capsys):
    vertices, lanes = "[[0, 0, {}], [10, 0, {}], [5, 0.05, {}], [5, 5, {}]]", "[[0, 1, {}], [1, 0, {}], [2, 3, {}], [3, 2, {}]]"
    (tmp_path / "cross.nav.yaml").write_text(f"building_name: cross\nlevels: {{L1: {{vertices: {vertices}, lanes: {lanes}}}}}\n")
    line = ["import", str(tmp_path / "cross.nav.yaml"), "--check"]
    assert main(line) == 0
    assert "t junction near miss" in capsys.readouterr().out
    assert main([*line, "--snap", "0.1"]) == 0
    assert "t junction near miss" not in capsys.readouterr().out
