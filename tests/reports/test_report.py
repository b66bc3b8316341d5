"""Reports: what they hold, that names stay names, that they stand alone, and what they refuse."""

import csv
import json
import os
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from mrp_sumo.cli.main import main
from mrp_sumo.errors import BatchError, MrpSumoError
from mrp_sumo.experiments.run import run_scenario
from mrp_sumo.io.scenario.read import read_scenario
from mrp_sumo.reports.paper.tables import table_2
from mrp_sumo.reports.report import _about, write_report
from mrp_sumo.reports.study import read_study

NASTY = "<script>alert(1)</script>&amp;\"'$x_{1}$ `a` | [b](c)"
VOID = {"meta", "br", "img", "link", "use", "path", "image", "rect"}


def results(maps=("office", "warehouse"), planners=("astar", "cbs", "ecbs"), robots=(5, 9), seeds=6, **columns):
    """A table as a batch writes it, with figures that are easy to check: planner k takes k + 1 ms, and cbs fails at seed 0 of warehouse."""
    rows = []
    for m, name in enumerate(maps):
        for n in robots:
            for k, planner in enumerate(planners):
                for seed in range(seeds):
                    result = not (planner == "cbs" and m == 1 and seed == 0)
                    arrives = result and not (planner == "astar" and seed < 2)
                    row = {
                        "key": f"{m}{n}{k}{seed}",
                        "status": "completed" if arrives else "time_limit" if result else "planning_timed_out",
                        "success": arrives,
                        "reason": "" if arrives else "too slow",
                        "repeat": 0,
                        "seed": seed,
                        "map": name,
                        "robots.count": n,
                        "planner": planner,
                        "planner.time_limit_s": 60.0,
                        "execution.policy": "adg",
                        "execution.time_limit_s": 300.0,
                        "discretisation.cell_m": 0.4,
                        "num_robots": n,
                        "plan_success": result,
                        "plan_valid": planner != "astar" if result else None,
                        "planning_time_s": (k + 1) / 1e3,
                        "makespan_steps": 40 + k if result else None,
                        "cost_steps": 100 + 10 * k + seed if result else None,
                        "soc_steps": 90 + k if result else None,
                        "lower_bound_steps": 90 if result else None,
                        "makespan_s": 80.0 + seed if result else None,
                        "driven_makespan_s": 80.0 + seed if result else None,
                        "execution_time_s": 60.0 + seed + k if result else None,
                        "goals_reached": n if arrives else 1,
                        "all_goals_reached": arrives,
                        "time_blocked_total_s": 5.0 * seed if result else None,
                        "min_clearance_m": 0.2 if result else None,
                        "num_overlaps": 0 if result else None,
                        "lateness_mean_s": -1.0 - seed if result else None,
                        "lateness_max_s": 0.5 if result else None,
                        "sim_time_s": 100.0 if result else None,
                    }
                    rows.append(row | {c: v(row) if callable(v) else v for c, v in columns.items()})
    return pd.DataFrame(rows)


def reported(tmp_path, frame, name="results.parquet"):
    frame.to_parquet(tmp_path / name)
    page = write_report(tmp_path / name, tmp_path / "report")
    return page, page.read_text()


def table(page: Path, name: str):
    """The rows of a CSV table as dictionaries."""
    with (page.parent / "tables" / f"{name}.csv").open() as file:
        return list(csv.DictReader(file))


class Checker(HTMLParser):
    """Every element is closed; every id is used once; nothing is fetched."""

    def __init__(self):
        super().__init__()
        self.open, self.ids, self.tags, self.references = [], [], set(), []

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value)
            if name in ("src", "href", "xlink:href"):
                self.references.append(value)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open and self.open.pop() == tag, f"{tag} is closed where it is not open"


def checked(text):
    checker = Checker()
    checker.feed(text)
    assert not checker.open
    twice = {i for i in checker.ids if checker.ids.count(i) > 1}
    assert not twice
    return checker


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return reported(tmp_path_factory.mktemp("study"), results())


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "first"
    run_scenario(read_scenario(Path(__file__).resolve().parents[2] / "scenarios" / "office_5.yaml"), folder)
    return folder


def test_page_stands_alone(study):
    _, text = study
    checker = checked(text)
    outside = [r for r in checker.references if not re.match(r"#|data:image/png|(figures|tables)/[a-z0-9_]+\.\w+$", r)]
    assert not outside
    assert not checker.tags & {"script", "iframe", "link", "object"}
    assert "http:" not in text.replace("http://www.w3.org/", "") and "https:" not in text


def test_every_link_of_the_page_leads_to_a_file(study):
    page, text = study
    for reference in checked(text).references:
        if reference.startswith(("figures/", "tables/")):
            assert (page.parent / reference).stat().st_size > 0


def test_what_is_beside_the_question_is_folded_and_its_link_leads_inside(study):
    _, page = study
    folded = re.findall(r"<details><summary><h2>([^<]+)</h2></summary>\n<div id=\"(\w+)\">", page)
    assert [title for title, _ in folded][:3] == ["Planning", "Cost", "Maps"]
    assert all(f'<a href="#{name}">{title}</a>' in page for title, name in folded)
    assert '<h2 id="success">' in page and '<h2 id="execution">' in page


def test_every_figure_is_there_as_svg_and_png_and_every_table_in_three_forms(study):
    page, _ = study
    for folder, kinds in (("figures", {".svg", ".png"}), ("tables", {".csv", ".md", ".tex"})):
        files = list((page.parent / folder).iterdir())
        assert {p.suffix for p in files} == kinds
        assert len(files) == len(kinds) * len({p.stem for p in files})


def test_the_papers_tables_and_figure_are_there(study):
    page, text = study
    for name in ("table_1_maps", "table_2_planning", "table_3_execution", "table_4_cost"):
        assert table(page, name)
    assert "Figure 5: planning time, office" in text
    assert (page.parent / "figures" / "figure_5_1.svg").is_file()
    assert "Time blocked, office" in text
    assert (page.parent / "figures" / "execution_2.svg").is_file()


def test_table_3_stands_beside_the_papers_printed_rates(study):
    page, _ = study
    (cbs,) = [r for r in table(page, "table_3_execution") if (r["map"], r["robots"], r["planner"]) == ("warehouse", "5", "CBS")]
    assert (cbs["paper normalised %"], cbs["paper overall %"]) == ("84", "70")


def test_table_2_counts_plans_found_and_their_time(study):
    page, _ = study
    (cbs,) = [r for r in table(page, "table_2_planning") if (r["map"], r["robots"], r["planner"]) == ("warehouse", "5", "CBS")]
    assert float(cbs["success %"]) == pytest.approx(100 * 5 / 6)
    assert float(cbs["mean ms"]) == pytest.approx(2.0)
    assert float(cbs["PAR2 s"]) == pytest.approx((5 * 0.002 + 120) / 6)
    assert float(cbs["paper %"]) == 83


def test_invalid_plans_are_no_success_and_stand_beside_as_mrp_benchs_count(study):
    page, text = study
    (astar,) = [r for r in table(page, "table_2_planning") if (r["map"], r["robots"], r["planner"]) == ("office", "5", "A*")]
    assert (float(astar["success %"]), float(astar["MRP-Bench success %"]), float(astar["PAR2 s"])) == (0, 100, 120)
    (astar,) = [r for r in table(page, "table_3_execution") if (r["map"], r["robots"], r["planner"]) == ("office", "5", "A*")]
    assert float(astar["overall %"]) == 0 and float(astar["MRP-Bench success %"]) == pytest.approx(100 * 4 / 6)
    assert "valid plans" in text


@pytest.mark.parametrize(("building", "of_paper"), [("warehouse", True), ("my hall", False)])
def test_words_of_the_paper_are_for_what_it_prints_figures_of(tmp_path, building, of_paper):
    page, text = reported(tmp_path, results(planners=("cbs",), robots=(5,), seeds=2, map=building))
    assert [word in text for word in ("Table III: execution", "Figure 5", "MRP-Bench success")] == [of_paper] * 3
    assert ("MRP-Bench success %" in table(page, "table_3_execution")[0]) is of_paper
    assert of_paper or "Execution success within 300 s" in text


@pytest.mark.parametrize(("anytime", "name"), [(None, "LaCAM"), (False, "LaCAM"), (True, "LaCAM*")])
def test_lacam_is_called_lacam_star_only_where_it_is_anytime(tmp_path, anytime, name):
    frame = results(maps=("office",), planners=("cbs", "lacam"), robots=(5,), seeds=2)
    if anytime is not None:
        frame["planner.parameters.anytime"] = [anytime if planner == "lacam" else None for planner in frame["planner"]]
    frame.to_parquet(tmp_path / "results.parquet")
    assert {str(row[2]) for row in table_2(read_study(tmp_path / "results.parquet")).rows} == {"CBS", name}


def test_table_3_tells_normalised_from_overall_success(study):
    page, _ = study
    (cbs,) = [r for r in table(page, "table_3_execution") if (r["map"], r["robots"], r["planner"]) == ("warehouse", "5", "CBS")]
    assert float(cbs["normalised %"]) == 100
    assert float(cbs["overall %"]) == pytest.approx(100 * 5 / 6)


def test_table_4_is_over_the_instances_that_every_planner_solved(study):
    page, _ = study
    rows = {(r["map"], r["robots"], r["planner"]): r for r in table(page, "table_4_cost")}
    office, warehouse = rows["office", "9", "ECBS"], rows["warehouse", "9", "ECBS"]
    assert office["instances"] == "6" and float(office["cost"]) == pytest.approx(120 + 2.5)
    assert warehouse["instances"] == "5" and float(warehouse["cost"]) == pytest.approx(120 + 3.0)  # without seed 0
    assert float(warehouse["paper makespan"]) == 65.6


def test_table_1_counts_bundled_maps_beside_the_paper(study):
    page, _ = study
    rows = {r["map"]: r for r in table(page, "table_1_maps")}
    assert (rows["office"]["vertices"], rows["office"]["edges"]) == ("29", "32")
    assert rows["warehouse, paper"]["free cells"] == "788"


def test_paired_differences_are_of_the_same_instances(study):
    page, _ = study
    (row,) = [r for r in table(page, "paired") if (r["first"], r["second"]) == ("CBS", "ECBS")]
    assert row["instances"] == "24" and row["both"] == "22"
    assert float(row["execution time s"]) == pytest.approx(1.0)


def test_worst_runs_begin_with_those_that_failed(study):
    page, _ = study
    statuses = [r["status"] for r in table(page, "worst_runs")]
    assert statuses[0] != "completed"


def test_the_same_results_give_the_same_bytes(tmp_path):
    frame = results(maps=("office",), planners=("cbs", "ecbs"), robots=(5,), seeds=3)
    frame.to_parquet(tmp_path / "results.parquet")
    pages = [write_report(tmp_path / "results.parquet", tmp_path / name) for name in ("a", "b")]
    files = [sorted(p.relative_to(page.parent) for p in page.parent.rglob("*") if p.is_file()) for page in pages]
    assert files[0] == files[1]
    for name in files[0]:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name


def test_names_are_text_never_markup(tmp_path):
    frame = results(maps=(NASTY, "名前 \u0007"), planners=(NASTY, "_hidden"), robots=(5,), seeds=2, reason=NASTY)
    page, text = reported(tmp_path, frame)
    assert "script" not in checked(text).tags
    assert "<script>alert" not in text
    for svg in (page.parent / "figures").glob("*.svg"):
        assert b"<script" not in svg.read_bytes()
    markdown = (page.parent / "tables" / "table_2_planning.md").read_text()
    assert len({len(re.findall(r"(?<!\\)\|", line)) for line in markdown.splitlines()}) == 1
    assert r"\$x\_\{1\}\$" in (page.parent / "tables" / "table_2_planning.tex").read_text()


FEW = {"maps": ("office",), "planners": ("cbs", "ecbs"), "robots": (5,), "seeds": 2}


@pytest.mark.parametrize(
    "frame",
    [
        results(maps=("office",), planners=("cbs",), robots=(5,), seeds=1),
        results(**FEW, status="crashed", success=False, plan_success=None, planning_time_s=None, sim_time_s=None, reason="boom"),
        results(**FEW)[["key", "status", "success", "planner", "map"]],
        results(**FEW, execution_time_s=np.nan, min_clearance_m=np.nan),
        pd.concat([results(**{"execution.patience_s": s}) for s in (0.0, np.inf)], ignore_index=True),
    ],
    ids=["one run", "all crashed", "few columns", "nothing measured", "infinite factor"],
)
def test_results_with_little_in_them_are_reported(tmp_path, frame):
    _, text = reported(tmp_path, frame)
    checked(text)


def test_a_factor_that_varies_gets_a_chart(tmp_path):
    frame = pd.concat(
        [results(maps=("office",), planners=("cbs",), robots=(5,), seeds=3, **{"planner.step_s": s, "key": f"{s}"}) for s in (1.6, 2.0)],
        ignore_index=True,
    )
    page, text = reported(tmp_path, frame)
    assert "Success against step (s)" in text
    assert list((page.parent / "figures").glob("lateness_planner_step_s_*.svg"))


def test_variants_of_a_planner_are_series_of_their_own(tmp_path):
    frame = pd.concat(
        [
            results(maps=("office",), planners=("ecbs",), robots=(5,), seeds=3, **{"planner.parameters.suboptimality": w})
            for w in (1.05, 1.2)
        ],
        ignore_index=True,
    )
    page, _ = reported(tmp_path, frame)
    assert {r["planner"] for r in table(page, "table_2_planning")} == {"ECBS, suboptimality 1.05", "ECBS, suboptimality 1.2"}


def test_map_suites_report_the_maps(tmp_path):
    facts = {"num_vertices": 29, "num_edges": 32, "num_components": 1, "extent_x_m": 21.5, "extent_y_m": 12.0}
    facts |= {"num_cells_total": 1248, "num_cells_free": 348, "num_cells_blocked": 900}
    frame = pd.DataFrame([{"key": "a", "status": "loaded", "success": True, "reason": "", "planner": "cbs", "map": "office", **facts}] * 2)
    page, text = reported(tmp_path, frame)
    assert table(page, "table_1_maps")[0]["cells"] == "1248"
    assert 'id="planning"' not in text


def test_report_of_a_run_has_its_charts(run_folder):
    page = write_report(run_folder)
    text = page.read_text()
    checked(text)
    assert "<title>office_5</title>" in text and "<h1>office_5</h1>" in text
    for title in ("Traffic on the floor plan", "Space and time on a lane", "What each robot did", "Lateness of the visits"):
        assert title in text
    assert {r["robot"] for r in table(page, "robots")} == {f"robot_{i}" for i in range(5)}


@pytest.mark.slow
def test_report_of_run_folders_links_the_replay_of_the_worst(run_folder, tmp_path):
    for name in ("good", "bad"):
        (tmp_path / name).mkdir()
        _copied(run_folder, tmp_path / name)
    document = json.loads((tmp_path / "bad" / "result.json").read_text())
    document["status"] = "time_limit"
    (tmp_path / "bad" / "result.json").write_text(json.dumps(document))
    (tmp_path / "bad" / "replay.html").write_text("a replay")
    page = write_report(tmp_path)
    assert [r["run"] for r in table(page, "worst_runs")] == ["bad", "good"]
    assert '<a href="../bad/replay.html">replay</a>' in page.read_text()


def test_a_report_is_replaced_and_nothing_else_is(tmp_path):
    results()[["key", "status", "success", "planner", "map"]].to_parquet(tmp_path / "results.parquet")
    out = tmp_path / "report"
    write_report(tmp_path / "results.parquet", out)
    (out / "stale.txt").write_text("of the report before")
    write_report(tmp_path / "results.parquet", out)
    assert not (out / "stale.txt").exists()
    other = tmp_path / "precious"
    other.mkdir()
    (other / "thesis.tex").write_text("years of work")
    with pytest.raises(MrpSumoError, match="not a report"):
        write_report(tmp_path / "results.parquet", other)
    assert (other / "thesis.tex").read_text() == "years of work"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["precious", "report", "results.parquet"]


def test_machines_that_somebody_listed_are_shown_as_texts():
    study = SimpleNamespace(frame=pd.DataFrame({"machine": [["a"], ["a"], None]}))
    assert _about(study)[0] == "Made on ['a']"


WITHOUT_UNTIL = b'{"format": 1, "suite": "a", "description": "", "code": "0", "axes": {}, "repeat": 1, "views": {}, "keys": []}'
WITH_HALF_A_CHARACTER = WITHOUT_UNTIL.replace(b'"description": ""', b'"description": "\\ud800", "until": "plan"')


@pytest.mark.parametrize(
    ("make", "output"),
    [
        (lambda p: p / "nowhere", "no such folder"),
        (lambda p: p, "neither a batch nor a run"),
        (lambda p: _written(p / "results.parquet", b"junk").parent / "results.parquet", "not a readable Parquet file"),
        (lambda p: _written(p / "result.json", b"{").parent, "not JSON"),
        (lambda p: _written(p / "result.json", b"[]").parent, "not the result of a run"),
        (lambda p: _written(p / "plan.json", b"{}").parent, "not the plan of a batch"),
        (lambda p: _written(p / "plan.json", WITHOUT_UNTIL).parent, "not the plan of a batch"),
        (lambda p: _written(p / "plan.json", WITH_HALF_A_CHARACTER).parent, "not the plan of a batch"),
        (lambda p: _frame(p / "results.parquet", pd.DataFrame({"a": [1]})), "no column 'status'"),
        (lambda p: _frame(p / "results.parquet", results().head(0)), "no rows"),
    ],
)
def test_bad_input_is_told_in_one_line(tmp_path, capsys, make, output):
    assert main(["report", str(make(tmp_path))]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and output in lines[0]
    assert not (tmp_path / "report").exists()


@pytest.mark.parametrize("name", ["trajectory.parquet", "visits.parquet", "events.jsonl", "plan.json", "floor.json", "building.json"])
@pytest.mark.parametrize("data", [b"PAR1 and no more", b"{}"], ids=["cut short", "empty"])
def test_a_run_with_a_damaged_file_is_told_in_one_line(run_folder, tmp_path, capsys, name, data):
    _copied(run_folder, tmp_path)
    (tmp_path / name).write_bytes(data)
    assert main(["report", str(tmp_path)]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.slow
def test_a_damaged_run_beside_others_is_told_and_the_rest_is_reported(run_folder, tmp_path):
    for name in ("good", "bad"):
        (tmp_path / name).mkdir()
        _copied(run_folder, tmp_path / name)
    (tmp_path / "bad" / "trajectory.parquet").write_bytes(b"PAR1")
    text = write_report(tmp_path).read_text()
    assert "Cannot be drawn" in text and "What each robot did" in text


def _copied(source, target):
    for file in source.iterdir():
        if file.is_file():
            (target / file.name).write_bytes(file.read_bytes())


def _written(path, data):
    path.write_bytes(data)
    return path


def _frame(path, frame):
    frame.to_parquet(path)
    return path


CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
HEADLESS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--allow-file-access-from-files",
    "--virtual-time-budget=5000",
]


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
@pytest.mark.parametrize("what", ["study", "run"])
def test_nothing_on_the_page_is_wider_than_a_phone(study, run_folder, tmp_path, what):
    """With MRP_SUMO_SCREENSHOTS=DIR, what the page looks like on a phone and a desk is left in DIR for people to look at."""
    page = study[0] if what == "study" else write_report(run_folder)
    (tmp_path / "phone.html").write_text(
        f"<iframe src='{page.as_uri()}' style='width:390px;height:844px'></iframe><script>onload = () => {{"
        "const root = frames[0].document.documentElement; document.body.dataset.width = root.scrollWidth }</script>"
    )
    command = [CHROMIUM, *HEADLESS, f"--user-data-dir={tmp_path / 'profile'}"]
    dom = subprocess.run([*command, "--dump-dom", (tmp_path / "phone.html").as_uri()], capture_output=True, text=True, timeout=120).stdout
    assert int(re.search(r'data-width="(\d+)"', dom)[1]) <= 390
    if folder := os.environ.get("MRP_SUMO_SCREENSHOTS"):
        for name, shown, size in (("phone", tmp_path / "phone.html", "406,860"), ("desk", page, "1280,2400")):
            picture = Path(folder).resolve() / f"report_{what}_{name}.png"
            picture.parent.mkdir(parents=True, exist_ok=True)
            subprocess.run([*command, f"--screenshot={picture}", f"--window-size={size}", shown.as_uri()], capture_output=True, timeout=120)
            assert picture.read_bytes().startswith(b"\x89PNG")


def test_file_that_is_no_table_of_results_is_refused_in_a_line(tmp_path):
    (tmp_path / "suite.yaml").write_text("base: office_5\n")
    with pytest.raises(BatchError, match=r"suite.yaml: expected a folder of results, or its results.parquet$"):
        write_report(tmp_path / "suite.yaml")
