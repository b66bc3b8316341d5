"""`mrp-sumo batch`, `status`, `query` and `compare` on real runs of the bundled office."""

import json
import os
import re
import signal
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pandas as pd
import pytest
import yaml

import mrp_sumo
from mrp_sumo.cli.main import main
from mrp_sumo.experiments import batch as batches
from mrp_sumo.io.results import MACHINE_COLUMNS
from mrp_sumo.metrics.registry import MACHINE_DEPENDENT
from mrp_sumo.reports.live.batch import BatchView

pytestmark = pytest.mark.slow

SUITES = sorted((Path(__file__).parents[2] / "scenarios/suites").glob("*.yaml"))
SUITE = """
name: study
description: Two planners.
base: {map: office, robots: {count: 2, draw: mrp_bench}}
grid_search:
  planner: [astar, cbs]
  seed: 3000..3002
views:
  cost: select planner, avg(soc_steps) as cost from results group by planner order by planner
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A suite and the folder of its batch."""
    folder = tmp_path_factory.mktemp("study")
    (folder / "study.yaml").write_text(SUITE)
    before, batches.code_version = batches.code_version, lambda: "1"  # whatever is edited meanwhile
    assert main(["batch", str(folder / "study.yaml"), "--out", str(folder / "out"), "--workers", "1"]) == 0
    yield folder
    batches.code_version = before


def test_runs_end_in_a_table_with_metrics(study):
    results = mrp_sumo.load_results(study / "out")
    assert list(results["planner"]) == ["astar"] * 3 + ["cbs"] * 3
    assert results["plan_success"].all()
    assert results[results["planner"] == "cbs"]["success"].all()
    assert (results["soc_steps"] >= results["lower_bound_steps"]).all()


def test_one_and_two_workers_give_equal_results(study):
    assert main(["batch", str(study / "study.yaml"), "--out", str(study / "two"), "--workers", "2"]) == 0
    one, two = (mrp_sumo.load_results(study / name) for name in ("out", "two"))
    assert list(one.columns) == list(two.columns)
    for column in one:
        if column not in (*MACHINE_COLUMNS, *MACHINE_DEPENDENT):
            assert [repr(v) for v in one[column]] == [repr(v) for v in two[column]], column


def test_dry_run_tells_runs_and_time_and_makes_none(study, capsys):
    assert main(["batch", str(study / "study.yaml"), "--out", str(study / "none"), "--dry-run"]) == 0
    output = capsys.readouterr().out
    assert output.startswith("study: 6 runs, 0 done, 6 to make\nTwo planners.\n  planner: astar, cbs (2)\n  seed: 3000, 3001, 3002 (3)\n")
    assert "planner=cbs seed=3001" in output
    assert "about" in output.splitlines()[-1]
    assert not (study / "none").exists()


def test_batch_in_a_pipe_is_quiet(study, capsys):
    assert main(["batch", str(study / "study.yaml"), "--out", str(study / "out")]) == 0
    output = capsys.readouterr()
    assert output.out == f"study: 6 of 6 runs done; {study}/out/results.parquet, {study}/out/results.csv\n"
    assert output.err == "mrp-sumo: going on: 6 of 6 runs done\n"


def test_status_counts_what_ended_how(study, capsys):
    assert main(["status", str(study / "out")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("study: 6 of 6 runs done, complete")
    assert any(line.split()[1:] == ["completed"] for line in lines[1:])


def test_query_answers_sql_and_views(study, capsys):
    assert main(["query", str(study / "out"), "select planner, count(*) as n from results group by planner order by 1", "--csv"]) == 0
    assert capsys.readouterr().out == "planner,n\nastar,3\ncbs,3\n"
    assert main(["query", str(study / "out"), "select quantile_cont(soc_steps, [0.1, 0.9]) as q, null as n from results"]) == 0
    assert "[" in capsys.readouterr().out
    assert main(["query", str(study / "out"), "select '[/]' || chr(27) || '[8m:bomb:' as \"[a]\""]) == 0
    assert capsys.readouterr().out.split() == ["[a]", r"[/]\x1b[8m:bomb:"]
    assert main(["query", str(study / "out"), "cost"]) == 0
    assert capsys.readouterr().out.split()[:2] == ["planner", "cost"]
    assert main(["query", str(study / "out")]) == 0
    assert "view cost: select planner" in capsys.readouterr().out


def test_views_of_bundled_suites_name_columns_that_there_are(study):
    suites = {path.stem: yaml.safe_load(path.read_text()) for path in SUITES}
    planned = {name: suite.get("views", {}) for name, suite in suites.items() if suite.get("until") != "map"}
    views = {(suite, name): sql for suite, of_suite in planned.items() for name, sql in of_suite.items()}
    assert views
    for (suite, name), sql in views.items():
        if "planner.parameters." in sql:
            continue  # only its own results have those columns
        assert main(["query", str(study / "out"), sql, "--csv"]) == 0, f"{suite}: {name}"


@pytest.mark.parametrize(
    ("arguments", "output"),
    [
        (["query", "OUT", "costs"], "'costs' is neither SQL nor a view of the suite (did you mean 'cost'?)"),
        (["query", "OUT", "select nothing from results"], "query: Binder Error"),
        (["query", "OUT/nowhere", "select 1"], "no such folder"),
        (["status", "SUITE"], "not the folder of a batch"),
        (["status", "SUITE", "--live"], "not the folder of a batch"),
        (["status", "OUT", "--live", "--port", "99999"], "--port: found '99999', expected"),
        (["status", "OUT", "--port", "9"], "--port is for --live"),
        (["batch", "STUDY", "--workers", "0"], "--workers: found 0, expected 1 to "),
        (["batch", "STUDY", "--memory-limit", "-5"], "--memory-limit: found -5, expected more than 0"),
        (["batch", "STUDY", "--out", "STUDY"], "study.yaml is not a folder; give another --out"),
        (["compare", "OUT", "OUT", "--metric", "soc_step"], "no metric 'soc_step' (did you mean 'soc_steps'?)"),
        (["compare", "OUT", "OUT", "--alpha", "2"], "--alpha: found 2, expected a number between 0 and 1"),
    ],
)
def test_bad_input_is_one_line(study, capsys, arguments, output):
    names = {"OUT": str(study / "out"), "OUT/nowhere": str(study / "nowhere"), "SUITE": str(study), "STUDY": str(study / "study.yaml")}
    assert main([names.get(argument, argument) for argument in arguments]) == 2
    error = capsys.readouterr().err
    assert output in error
    assert error.count("\n") == 1


def test_compare_passes_a_folder_against_itself_and_fails_a_costlier_one(study, capsys, tmp_path):
    out = str(study / "out")
    assert main(["compare", out, out]) == 0
    assert "6 runs in common" in capsys.readouterr().out
    results = mrp_sumo.load_results(out)
    results["makespan_s"] *= 1.5
    results.to_parquet(tmp_path / "slow.parquet")
    assert main(["compare", out, str(tmp_path / "slow.parquet"), "--metric", "makespan_s", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["differences"][0]["num_worse"] == 6


@pytest.mark.slow
def test_worst_runs_are_kept_and_linked_in_the_report(study, capsys):
    suite, out = study / "study.yaml", study / "out"
    results = mrp_sumo.load_results(out)
    worst = results.sort_values(["success", "time_blocked_total_s"], ascending=[True, False])["key"].iloc[0]
    assert main(["batch", str(suite), "--out", str(out), "--keep-worst", "1"]) == 0
    assert f"the worst run is kept in {out}/kept" in capsys.readouterr().err
    assert [folder.name for folder in (out / "kept").iterdir()] == [worst]
    rest = json.loads((out / "kept" / worst / "result.json").read_text())
    recorded = results.set_index("key").loc[worst]
    assert rest["status"] == recorded["status"]
    assert rest["metrics"]["time_blocked_total_s"] == recorded["time_blocked_total_s"]
    assert main(["report", str(out)]) == 0
    text = (out / "report" / "index.html").read_text()
    assert f'<a href="../kept/{worst}/replay.html">replay</a>' in text
    shown = re.sub(r'href="[^"]*"|id="[^"]*"|"#?run_[^"]*"', "", re.sub(r"<svg.*?</svg>", "", text, flags=re.DOTALL))
    assert worst[:8] in shown and worst not in shown  # nobody reads twenty digits


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_interrupted_batch_finishes_what_runs_and_says_how_to_go_on(study, tmp_path, number, code):
    (tmp_path / "long.yaml").write_text(SUITE.replace("name: study", "name: long").replace("3000..3002", "3000..3400"))
    command = [
        sys.executable,
        "-m",
        "mrp_sumo.cli.main",
        "batch",
        str(tmp_path / "long.yaml"),
        "--out",
        str(tmp_path / "out"),
        "--workers",
        "1",
    ]
    program = "import sys; from mrp_sumo.cli.main import main; sys.exit(main(sys.argv[1:]))"
    process = subprocess.Popen(
        [command[0], "-c", program, *command[3:]], stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=os.environ
    )
    deadline = time.monotonic() + 120
    while len(list((tmp_path / "out").glob("runs/*/*.json"))) < 2 and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(number)
    output = process.communicate(timeout=120)[1]
    assert process.returncode == code
    assert "ending after the runs under way" in output
    assert f"to go on: mrp-sumo batch {tmp_path / 'long.yaml'} --out {tmp_path / 'out'}" in output
    assert len(mrp_sumo.load_results(tmp_path / "out")) >= 2


def test_keeping_none_of_the_worst_is_said_and_fails(tmp_path, capsys):
    suite, out = tmp_path / "planned.yaml", tmp_path / "out"
    suite.write_text("base: {map: office, robots: 2}\nuntil: plan\ngrid_search: {seed: [0]}\n")
    assert main(["batch", str(suite), "--out", str(out), "--workers", "1", "--keep-worst", "1"]) == 1
    errors = [line for line in capsys.readouterr().err.splitlines() if "runs done" not in line]  # of which slow machines print more
    assert errors == ["mrp-sumo: no run was driven, so there is none to keep"]


def test_page_of_a_batch_fills_as_runs_end(study, tmp_path):
    records = sorted((study / "out" / "runs").rglob("*.json"))
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "plan.json").write_bytes((study / "out" / "plan.json").read_bytes())
    view, odd = BatchView(tmp_path / "out"), []
    for record in (None, *records):
        if record:
            place = tmp_path / "out" / record.relative_to(study / "out")
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(record.read_bytes())
        view.look(odd.append)
        view.look(odd.append)  # nothing new
    (tmp_path / "out" / "runs" / "zz").mkdir()
    (tmp_path / "out" / "runs" / "zz" / "zz.json").write_text("{}")
    view.look(odd.append)
    with urllib.request.urlopen(view.server.address, timeout=60) as page:
        assert b"<h1>study</h1>" in page.read()
    view.broadcast.end()
    said = [json.loads(text.split("data: ")[1]) for text, _ in view.broadcast.stream() if text.startswith("event: runs")]
    view.close()
    assert [len(one["runs"]) for one in said] == [0] + [1] * 6 and [one["state"] for one in said] == ["not under way"] * 6 + ["complete"]
    assert sorted(run[0] for one in said for run in one["runs"]) == list(range(6))
    assert {run[3] for one in said for run in one["runs"]} == {"astar", "cbs"} and len(odd) == 1 and "not a whole record" in odd[0]


def test_status_leaves_files_of_strangers_alone(study, capsys):
    (study / "out" / "runs" / ".DS_Store").write_bytes(b"\x00")
    assert main(["status", str(study / "out")]) == 0
    assert capsys.readouterr().out.startswith("study: 6 of 6 runs done")


@pytest.mark.parametrize("name", ["..", ".", "a" * 300])
def test_name_of_a_batch_is_a_folder_of_its_own(tmp_path, name, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study.yaml").write_text(f"name: {name}\nbase: office_5\ngrid_search: {{seed: [0]}}\n")
    assert main(["batch", "study.yaml", "--dry-run"]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"mrp-sumo: study.yaml:1: name: found '{name[:40]}")
    assert len(error.splitlines()) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    "sql",
    [
        "select * from read_text('FOLDER/secret.txt')",
        "select * from 'FOLDER/secret.csv'",
        "select * from glob('FOLDER/*')",
        "copy results to 'FOLDER/written.csv'",
        "select 1; copy (select 1) to 'FOLDER/written.csv'",
        "attach 'FOLDER/written.db'",
        "export database 'FOLDER/written'",
        "set enable_external_access = true",
        "set lock_configuration = false",
        "set memory_limit = '100GB'",
        "install httpfs",
        "load httpfs",
        "select * from frame_of_the_program",
        "create table large as select range as a from range(1000000000)",
    ],
)
def test_view_of_a_stranger_reaches_no_files_and_no_settings(study, tmp_path, capsys, sql):
    frame_of_the_program = pd.DataFrame({"a": [1]})
    assert len(frame_of_the_program) == 1
    for name in ("secret.txt", "secret.csv"):
        (tmp_path / name).write_text("secret,word")
    before = sorted(tmp_path.iterdir())
    assert main(["query", str(study / "out"), sql.replace("FOLDER", str(tmp_path))]) == 2
    said = capsys.readouterr()
    assert said.err.startswith("mrp-sumo: query: ") and said.err.count("\n") == 1
    assert "secret,word" not in said.out + said.err and sorted(tmp_path.iterdir()) == before
