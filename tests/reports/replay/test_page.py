"""The replay page holds the run, to half a centimetre; names cannot become HTML; bad run folders are refused in one line."""

import base64
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import urllib.request
import zlib
from dataclasses import fields, replace

import numpy as np
import pytest
from vehicles import TRICYCLE, TUGGER
from worlds import NASTY, record_of_two

from mrp_sumo.cli.main import main
from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import NavGraph, nav_graph
from mrp_sumo.core.robot_type import Loaded
from mrp_sumo.core.task import StopLog, log_of_times
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.io.outline import Outline
from mrp_sumo.io.record import AT_GOAL
from mrp_sumo.reports.pictures.view import ABSENT
from mrp_sumo.reports.replay.page import About, replay_page, write_replay


def read_back(page):
    """Head and columns of a page: the inverse of what the page's own reader does, written apart from it."""
    text = {i: re.search(rf'<script type="[\w/]+" id="{i}">(.*?)</script>', page, re.S)[1] for i in ("run-head", "run-data")}
    head = json.loads(text["run-head"])
    raw = np.frombuffer(zlib.decompress(base64.b64decode(text["run-data"])), np.uint8)
    columns = {}
    for c in head["manifest"]:
        count = c["rows"] * c["length"]
        planes = raw[c["offset"] : c["offset"] + count * c["size"]].reshape(c["size"], count).astype(np.int64)
        words = (planes * 256 ** np.arange(c["size"])[:, None]).sum(0)
        if c["order"]:
            words = (words >> 1) ^ -(words & 1)
        words = words.reshape(c["rows"], c["length"])
        for _ in range(c["order"]):
            words = words.cumsum(axis=1)
        columns[c["name"]] = words % 256 ** c["size"]
    return head | json.loads(bytes(columns.pop("long")[0].astype(np.uint8))), columns


def test_page_holds_poses_to_half_a_unit():
    record = record_of_two()
    head, columns = read_back(replay_page(record, About("trial")))
    there = np.isfinite(record.execution.x_m).T
    low = np.array([0.5, 0.5]) - 0.6  # of the cells' centres, less the margin
    for name, truth, origin in (("x", record.execution.x_m, low[0]), ("y", record.execution.y_m, low[1])):
        shown = columns[name] * head["unit_m"] + origin
        assert np.abs(shown - truth.T)[there].max() <= head["unit_m"] / 2 + 1e-9
    turned = (columns["yaw"] / 128 * np.pi - record.execution.yaw_rad.T + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(turned).max() <= np.pi / 256 + 1e-9
    assert head["period_s"] == 0.1
    assert head["num_samples"] == 41


def test_page_says_where_trucks_have_forks_and_which_lanes_the_plan_takes_backward():
    record = record_of_two()
    plain, columns = read_back(replay_page(record, About("run")))
    assert "forks" not in plain and "plan_backward" not in columns
    trucks = replace(record, fleet=fleet_of(TRICYCLE, 2))
    facing = record.execution.yaw_rad.copy()
    facing[0] = [np.pi, facing[0, 1]]  # the first faces away from its goal: it comes backward
    head, columns = read_back(replay_page(replace(trucks, execution=replace(record.execution, yaw_rad=facing)), About("run")))
    assert head["forks"] == [-1, -1]
    first = record.plan.first.tolist()
    assert columns["plan_backward"].ravel().tolist() == [1] * first[1] + [0] * (first[2] - first[1])


def test_rows_of_trailers_and_loads_come_after_those_of_robots():
    record = record_of_two()
    loads, angle = np.zeros(record.execution.x_m.shape, np.int64), np.zeros_like(record.execution.x_m)
    loads[10:20, 0] = 1
    hitch_rad = {"hitch_1_rad": angle, "hitch_2_rad": angle}
    fleet = fleet_of(replace(TUGGER, loaded=Loaded(width_m=0.8)), 2)
    run = replace(record, fleet=fleet, execution=replace(record.execution, loads=loads, hitch_rad=hitch_rad))
    head, columns = read_back(replay_page(run, About("trial")))
    assert (head["owner"], head["bar"]) == ([0, 0, 1, 1, 0, 1], [0.7, 0.7, 0.7, 0.7, 0, 0])
    assert (head["length"], head["width"]) == ([1.0, 1.0, *[0.7] * 4, 1.0, 1.0], [0.6] * 6 + [0.8, 0.8])
    assert columns["x"].shape == columns["state"].shape == (8, 41)
    state = columns["state"]
    assert (state[2:4] == state[0]).all() and (state[4:6] == state[1]).all()  # in the state of who tows it
    assert (state[6, 10:20] == state[0, 10:20]).all() and set(state[6, :10]) | set(state[6, 20:]) | set(state[7]) == {ABSENT}
    plain, alone = read_back(replay_page(record, About("trial")))
    assert "owner" not in plain and "bar" not in plain and len(alone["x"]) == len(plain["length"]) == 2


def test_levels_have_boxes_where_there_are_several():
    xy, lanes = [[0, 0], [4, 0], [10, 0], [10, 3]], [[0, 1], [2, 3]]
    two = nav_graph(name="two", xy=xy, lanes=lanes, level_names=("L1", "L2"), level=[0, 0, 1, 1])
    head, _ = read_back(replay_page(replace(record_of_two(), nav=two), About("trial")))
    first, second = head["map"]["levels"]
    assert [(level["name"], level["width"], level["height"]) for level in (first, second)] == [("L1", 4.0, 0.0), ("L2", 0.0, 3.0)]
    assert (second["x"] - first["x"], second["y"] - first["y"]) == (10.0, 3.0)  # upper left corners
    one = nav_graph(name="one", xy=xy, lanes=lanes)
    assert read_back(replay_page(replace(record_of_two(), nav=one), About("trial")))[0]["map"]["levels"] == []


def test_plan_and_events_come_back():
    record = record_of_two()
    head, columns = read_back(replay_page(record, About("trial")))
    assert columns["plan_first"].tolist() == [[0, 4, 6]]
    assert [head["vertices"][v] for v in columns["plan_vertex"][0]] == [record.graph.label(v) for v in record.plan.vertex]
    assert columns["plan_arrive"][0].tolist() == [0, 1000, 2000, 3000, 0, 3000]
    assert columns["plan_depart"][0].tolist() == [0, 1000, 2000, 2**32 - 1, 2000, 2**32 - 1]
    assert columns["plan_arrived"][0].tolist() == [0, 1000, 2000, 3000, 0, 3000]
    assert [head["event_kinds"][k] for k in columns["event_kind"][0]] == ["blocked", "goal"]
    assert columns["event_other"][0].tolist() == [0, 2**32 - 1]
    assert columns["event_duration"][0].tolist() == [1000, 0]
    assert head["event_text"] == {"0": "because of a"}


def test_curves_of_lanes_that_the_plan_takes_are_on_the_page():
    """Halfway along the first lane of the plan its curve is 0.2 m aside; the other one is between places that nothing names."""
    record = record_of_two()
    tail, head = record.plan.vertex[:2].tolist()
    (ax, ay), (bx, by) = record.graph.xy[[tail, head]].tolist()
    arc = np.array([[0.0, ax, ay, 0.5], [0.6, (ax + bx) / 2 + 0.2, (ay + by) / 2 + 0.2, 0.7], [1.2, bx, by, 0.9]])
    unused = set(range(record.graph.num_vertices)) - set(record.plan.vertex.tolist())
    curved = replace(record, graph=replace(record.graph, curves={(tail, head): arc, (min(unused), tail): arc}))
    page, _ = read_back(replay_page(curved, About("trial")))
    ((key, nodes),) = page["bends"].items()
    assert [page["vertices"][int(v)] for v in key.split(",")] == [record.graph.label(v) for v in (tail, head)]
    low = np.array([0.5, 0.5]) - 0.6  # of the cells' centres, less the margin
    assert np.allclose(nodes, np.column_stack([[0, 0.5, 1], arc[:, 1:3] - low, arc[:, 3]]), atol=1e-4)


def test_names_cannot_become_html():
    page = replay_page(record_of_two(names=(NASTY, "{{data}}")), About(NASTY, note=NASTY, facts=((NASTY, NASTY),)))
    plain = replay_page(record_of_two(), About("trial"))
    assert page.count("<script") == plain.count("<script")
    assert page.count("<img") == 0
    head, columns = read_back(page)
    assert head["robots"] == [NASTY, "{{data}}"]
    assert head["name"] == NASTY
    assert columns["x"].shape == (2, 41)


def test_a_name_that_is_no_text_is_told_as_far_as_it_can_be():
    head, _ = read_back(replay_page(record_of_two(names=("\ud800", "b")), About("trial")))
    assert head["robots"][1] == "b"


def modules_of(page):
    """The page's own scripts, by the name under which they are imported."""
    places = json.loads(re.search(r'<script type="importmap">(.*?)</script>', page, re.S)[1])["imports"]
    kind = "data:text/javascript;base64,"
    assert all(place.startswith(kind) for place in places.values())
    return {name: base64.b64decode(place.removeprefix(kind)).decode() for name, place in places.items()}


def own_code(page):
    """What we wrote of a page: its HTML and scripts without the library and the run."""
    return "\n".join([re.sub(r'<script type="text/plain".*?</script>', "", page, flags=re.S), *modules_of(page).values()])


def test_every_import_of_a_script_is_exported_by_another():
    modules = modules_of(replay_page(record_of_two(), About("trial")))
    exported = {name: set(re.findall(r"^export (?:async )?(?:function|class|const) (\w+)", text, re.M)) for name, text in modules.items()}
    taken = set()
    for name, text in modules.items():
        for names, source in re.findall(r'^import \{ (.*) \} from "(.*)";$', text, re.M):
            assert set(names.split(", ")) <= exported[source], (name, source)
            taken |= {(source, word) for word in names.split(", ")}
            assert all(len(re.findall(rf"\b{word}\b", text)) > 1 for word in names.split(", ")), (name, source)
    assert taken == {(name, word) for name, words in exported.items() for word in words}


def test_page_asks_no_network():
    own = own_code(replay_page(record_of_two(), About("trial")))
    assert not re.findall(r"""(?:src|href)\s*=\s*["'](?!data:,|#)[^"']+""", own)
    assert "import(" not in own
    assert "fetch(" not in own


def test_page_sets_no_html():
    own = own_code(replay_page(record_of_two(), About("trial")))
    assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(", own)


def test_long_runs_are_thinned(monkeypatch):
    monkeypatch.setattr("mrp_sumo.reports.replay.page.MAX_POSES", 30)
    head, columns = read_back(replay_page(record_of_two(), About("trial")))
    assert columns["x"].shape == (2, 14)  # every third of 41
    assert head["period_s"] == pytest.approx(0.3)


def test_a_run_without_samples_or_robots_is_refused():
    record = record_of_two()
    none = {name: getattr(record.execution, name)[:0] for name in ("t_s", "x_m", "y_m", "yaw_rad", "speed_mps")}
    with pytest.raises(MrpSumoError, match="nothing to replay: 2 robots, 0 samples"):
        replay_page(replace(record, execution=replace(record.execution, **none)), About("trial"))


def test_building_of_no_walls_is_drawn():
    outline = Outline(np.zeros((0, 2, 2)), np.zeros((0, 2, 2)), (), (), ())
    head, _ = read_back(replay_page(record_of_two(), About("trial", outline=outline)))
    assert head["map"]["walls"] == []


def test_a_grid_map_shows_its_cells_also_when_read_back():
    record = record_of_two()
    for nav in (None, NavGraph(**{f.name: getattr(record.graph, f.name) for f in fields(NavGraph)})):
        head, _ = read_back(replay_page(replace(record, nav=nav), About("trial")))
        assert head["map"]["cells"] == [pytest.approx([0.1, 0.1 + row, 4, 1]) for row in range(3)]
        assert not head["map"]["lanes"]


def test_real_run_gives_one_page_and_the_same_again(folder, tmp_path, capsys):
    assert main(["replay", str(folder)]) == 0
    assert "replay.html" in capsys.readouterr().out
    first = (folder / "replay.html").read_bytes()
    assert main(["replay", str(folder), "--out", str(tmp_path / "other.html")]) == 0
    assert (tmp_path / "other.html").read_bytes() == first
    assert 300_000 < len(first) < 600_000  # the library is most of it
    head, columns = read_back(first.decode())
    assert columns["state"].shape[0] == len(head["robots"]) == 5
    assert (columns["state"][:, -1] == AT_GOAL).sum() >= 4  # the last one may still be slowing down
    assert head["map"]["walls"]
    assert head["map"]["furniture"]
    assert {"charger", "parking"} <= {s["kind"] for s in head["map"]["stations"]}


def never_written(run, *names):
    """Take files out of a run folder as if the run had not made them."""
    result = json.loads((run / "result.json").read_text(encoding="utf-8"))
    for name in names:
        (run / name).unlink()
        del result["files"][name]
    (run / "result.json").write_text(json.dumps(result), encoding="utf-8")


def test_run_that_was_not_executed_shows_its_plan(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "run")
    never_written(tmp_path / "run", "trajectory.parquet", "events.jsonl", "visits.parquet")
    head, columns = read_back(write_replay(tmp_path / "run").read_text(encoding="utf-8"))
    assert head["plan_only"]
    assert "plan only" in head["status_text"]
    assert set(columns["state"][:, -1]) == {AT_GOAL}


def test_run_writes_the_page_where_asked(tmp_path):
    assert main(["run", "office_5", "--planner", "prioritised", "--replay", "--out", str(tmp_path / "run")]) == 0
    head, _ = read_back((tmp_path / "run" / "replay.html").read_text(encoding="utf-8"))
    assert head["name"] == "office_5"


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code", "line"), [(signal.SIGINT, 0, ""), (signal.SIGTERM, 143, "mrp-sumo: ended by SIGTERM\n")])
def test_serve_answers_until_interrupted(folder, number, code, line):
    command = [sys.executable, "-c", "from mrp_sumo.cli.main import main; raise SystemExit(main())", "replay", str(folder), "--serve"]
    environment = {**os.environ, "BROWSER": "true"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment) as server:
        try:
            server.stdout.readline()
            address = server.stdout.readline().split()[0]
            with urllib.request.urlopen(address, timeout=120) as answer:
                assert answer.read() == (folder / "replay.html").read_bytes()
                assert answer.headers["Content-Type"] == "text/html; charset=utf-8"
        finally:
            server.send_signal(number)
            _, said = server.communicate(timeout=120)
    assert (server.returncode, said) == (code, line)


@pytest.mark.parametrize(
    ("spoil", "output"),
    [
        (lambda run: shutil.rmtree(run), "no such folder"),
        (lambda run: (run / "result.json").unlink(), "no complete run"),
        (lambda run: (run / "result.json").write_text('{"status":'), "not JSON"),
        (lambda run: (run / "result.json").write_text("[1]"), "not the result of a run"),
        (
            lambda run: (run / "result.json").write_text('{"status": "completed", "scenario": {}, "metrics": {}}'),
            "damaged, or of another version",
        ),
        (lambda run: (run / "floor.json").write_text("{}"), "schema version"),
        (lambda run: (run / "floor.json").unlink(), "no such file"),
        (lambda run: (run / "building.json").write_text("{}"), "not the outline of a building"),
        (lambda run: (run / "trajectory.parquet").write_bytes(b"PAR1"), "Parquet"),
        (lambda run: (run / "events.jsonl").write_text("not json\n"), "not JSON"),
        (lambda run: (run / "events.jsonl").unlink(), "events.jsonl: no such file"),
        (lambda run: (run / "trajectory.parquet").unlink(), "trajectory.parquet: lost, the run wrote it"),
        (lambda run: (run / "plan.json").unlink(), "plan.json: lost, the run wrote it"),
        (lambda run: never_written(run, "trajectory.parquet", "plan.json"), "nothing to replay"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_bad_run_folder_is_told_in_one_line(folder, tmp_path, capsys, spoil, output):
    shutil.copytree(folder, tmp_path / "run")
    spoil(tmp_path / "run")
    assert main(["replay", str(tmp_path / "run"), "--out", str(tmp_path / "page.html")]) == 2
    said = capsys.readouterr().err
    assert output in said
    assert len(said.splitlines()) == 1
    assert not list(tmp_path.glob("*page.html*"))


def test_page_is_not_written_over_a_folder(folder, tmp_path, capsys):
    assert main(["replay", str(folder), "--out", str(tmp_path)]) == 2
    assert "is a folder" in capsys.readouterr().err


def test_page_below_no_folder_is_refused(folder, tmp_path, capsys):
    assert main(["replay", str(folder), "--out", str(tmp_path / "none" / "page.html")]) == 2
    assert "cannot be written" in capsys.readouterr().err


def test_the_library_comes_with_its_licence():
    from mrp_sumo.reports.replay.page import SOURCES

    assert b"PixiJS - v8.22.0" in (SOURCES / "pixi.min.js").read_bytes()[:2000]
    licence = (SOURCES / "pixi.LICENSE.txt").read_text(encoding="utf-8")
    for package in ("pixi.js", "earcut", "eventemitter3", "tiny-lru"):
        assert f"==== {package} " in licence


def test_tasks_stand_on_the_page_with_the_queues_of_their_stations():
    record, none = record_of_two(), np.nan
    times = [np.array(column) for column in ([0.0, 1.0], [0.5, none], [1.0, none], [3.0, none])]
    tasks = log_of_times(("order_0", "order_1"), np.array([1, -1]), *times)
    numbers = [np.array([value]) for value in (0.5, 1.0, 3.0, 0.1, 0.25, np.inf)]
    stops = StopLog(np.zeros(1, int), np.ones(1, int), ("pack",), np.zeros(1, int), *numbers)
    head, _ = read_back(replay_page(replace(record, execution=replace(record.execution, tasks=tasks, stops=stops)), About("trial")))
    assert head["tasks"]["times"] == [[0.0, 0.5, 1.0, 3.0], [1.0, None, None, None]] and head["tasks"]["robot"] == [1, -1]
    assert head["tasks"]["stations"] == [["pack", [[0.75, 1.0, 3.0]]]]
    assert read_back(replay_page(record, About("trial")))[0]["tasks"] is None
