"""Suites expand to the runs they say, and refuse what no run could use in one line with its place."""

import json

import pytest

from mrp_sumo.errors import ScenarioError
from mrp_sumo.experiments.identity import code_version
from mrp_sumo.experiments.suite import find_suite, read_suite, runs_of
from mrp_sumo.io.columns import parameter_columns
from mrp_sumo.maps.catalogue import bundled_folder

SUITES = sorted((bundled_folder("scenarios") / "suites").glob("*.yaml"))


def suite(folder, text):
    path = folder / "study.yaml"
    path.write_text(text)
    return read_suite(path)


def columns(runs):
    return [parameter_columns(json.loads(run.scenario)) for run in runs]


def test_all_combinations_are_runs_and_the_last_key_is_fastest(tmp_path):
    file = suite(tmp_path, "base: office_5\ngrid_search:\n  map: [office, warehouse]\n  seed: 7..9\n")
    assert [(c["map"], c["seed"]) for c in columns(runs_of(file, "1"))] == [
        (name, seed) for name in ("office", "warehouse") for seed in (7, 8, 9)
    ]


def test_range_in_a_list_is_written_out(tmp_path):
    file = suite(tmp_path, "base: office_5\ngrid: {seed: [0..2, 10]}\n")
    assert [c["seed"] for c in columns(runs_of(file, "1"))] == [0, 1, 2, 10]


def test_figure_of_a_type_is_an_axis_and_a_number_of_robots_stays_their_count(tmp_path):
    text = "base: {map: office, robots: 3}\ngrid_search: {robots.type.max_speed_mps: [0.2, 0.3]}\n"
    rows = columns(runs_of(suite(tmp_path, text), "1"))
    assert [(c["robots.count"], c["robots.type.max_speed_mps"], c["robots.type.accel_mps2"]) for c in rows] == [
        (3, 0.2, 2.5),
        (3, 0.3, 2.5),
    ]


def test_repeated_runs_have_keys_of_their_own(tmp_path):
    runs = runs_of(suite(tmp_path, "base: office_5\nrepeat: 3\n"), "1")
    assert [run.repeat for run in runs] == [0, 1, 2]
    assert len({run.key for run in runs}) == len({run.scenario_key for run in runs}) == 3


def test_values_that_mean_the_same_are_one_run(tmp_path):
    assert len(runs_of(suite(tmp_path, "base: office_5\ngrid_search:\n  planner: [cbs, {name: cbs}]\n"), "1")) == 1


def test_excluded_runs_are_left_out(tmp_path):
    file = suite(
        tmp_path,
        "base: office_5\ngrid_search:\n  map: [office, warehouse]\n  robots.count: [5, 9]\n  seed: 0..3\n"
        "exclude:\n- {map: office, robots.count: 9}\n- {map: warehouse, seed: 1..3}\n",
    )
    assert [(c["map"], c["robots.count"], c["seed"]) for c in columns(runs_of(file, "1"))] == [
        *(("office", 5, seed) for seed in range(4)),
        ("warehouse", 5, 0),
        ("warehouse", 9, 0),
    ]


def test_naming_a_planner_keeps_its_limit_and_drops_the_parameters_of_another(tmp_path):
    file = suite(
        tmp_path,
        "base: {map: office, robots: {count: 2}, planner: {name: pibt, time_limit_s: 9, parameters: {max_steps: 50}}}\n"
        "grid_search:\n  planner: [pibt, astar, {name: pibt, parameters: {max_steps: 70}}]\n",
    )
    result = columns(runs_of(file, "1"))
    assert [(c["planner"], c["planner.time_limit_s"], c.get("planner.parameters.max_steps")) for c in result] == [
        ("pibt", 9.0, None),
        ("astar", 9.0, None),
        ("pibt", 9.0, 70),
    ]


def test_another_map_keeps_nothing_of_the_one_before(tmp_path):
    file = suite(
        tmp_path,
        "base: {map: {file: office, graph: 0}, robots: {count: 2}}\n"
        "grid_search:\n  map: [office, {file: airport, graph: all}, {file: warehouse}]\n  discretisation: [roadmap, {cell_m: 0.5}]\n",
    )
    result = columns(runs_of(file, "1"))
    assert [(c["map"], c["map.graph"]) for c in result[::2]] == [("office", None), ("airport", "all"), ("warehouse", None)]
    assert [(c["discretisation"], c["discretisation.cell_m"]) for c in result[:2]] == [("roadmap", 0.4), ("auto", 0.5)]


def test_order_of_parameters_is_no_reason_to_run_again(tmp_path):
    keys = []
    for parameters in ("{max_steps: 70, num_attempts: 2}", "{num_attempts: 2, max_steps: 70}"):
        text = f"base: {{map: office, robots: {{count: 2}}, planner: {{name: pibt, parameters: {parameters}}}}}\nrepeat: 2\n"
        keys.append([run.key for run in runs_of(suite(tmp_path, text), "1")])
    assert keys[0] == keys[1]


def test_key_depends_on_code_and_map_content_and_scenario_key_on_neither(tmp_path):
    map_file = bundled_folder("networks") / "office" / "office.building.yaml"
    (tmp_path / "mine.building.yaml").write_text(map_file.read_text())
    file = suite(tmp_path, "base: {map: mine.building.yaml, robots: {count: 2}}\ngrid_search: {seed: 0..1}\n")
    one, other_code = runs_of(file, "1")[0], runs_of(file, "2")[0]
    (tmp_path / "mine.building.yaml").write_text(map_file.read_text() + "# changed\n")
    other_map = runs_of(file, "1")[0]
    assert len({one.key, other_code.key, other_map.key}) == 3
    assert one.scenario_key == other_code.scenario_key == other_map.scenario_key


def test_key_depends_on_what_a_map_file_refers_to(tmp_path):
    (tmp_path / "ros.yaml").write_text("image: room.pgm\nresolution: 0.4\norigin: [0, 0, 0]\n")
    (tmp_path / "tasks.scen").write_text("version 1\n0\troom.map\t2\t1\t0\t0\t1\t0\t1\n")
    keys = []
    for shade, cell in ((254, "."), (0, "@")):
        (tmp_path / "room.pgm").write_bytes(b"P5 2 1 255 " + bytes([254, shade]))
        (tmp_path / "room.map").write_text(f"type octile\nheight 1\nwidth 2\nmap\n.{cell}\n")
        file = suite(tmp_path, "base: {map: ros.yaml, robots: {count: 1}}\ngrid_search: {map: [ros.yaml, tasks.scen]}\n")
        keys += [run.key for run in runs_of(file, "1")]
    assert len(set(keys)) == 4
    (tmp_path / "room.pgm").unlink()
    with pytest.raises(ScenarioError, match=r"^study.yaml:2: grid_search.map: ros.yaml:1: image 'room.pgm' is not there$"):
        runs_of(file, "1")


@pytest.mark.parametrize("values", ["tasks: named.csv", "planner: {name: plan_file, parameters: {path: named.csv}}"])
def test_key_depends_on_the_files_that_a_scenario_names(tmp_path, values):
    keys = []
    for text in ("release_s,stops\n0,lobby\n", "release_s,stops\n5,lobby\n"):
        (tmp_path / "named.csv").write_text(text)
        file = suite(tmp_path, f"base: {{map: office, robots: 2, {values}}}\ngrid_search: {{seed: [0]}}\n")
        keys += [run.key for run in runs_of(file, "1")]
    assert len(set(keys)) == 2


def test_map_as_a_mapping_replaces_that_of_the_base(tmp_path):
    (tmp_path / "base.yaml").write_text("map: {file: office, graph: 0, level: L1, snap_m: 0.2}\nrobots: {count: 2}\n")
    file = suite(tmp_path, "base: base.yaml\ngrid_search:\n  map:\n  - {file: warehouse, meters_per_pixel: 0.05}\n  - office\n")
    own, named = columns(runs_of(file, "1"))
    assert [own[f"map{key}"] for key in ("", ".meters_per_pixel", ".graph", ".level", ".snap_m")] == ["warehouse", 0.05, None, None, None]
    assert [named[f"map{key}"] for key in ("", ".meters_per_pixel", ".graph", ".level", ".snap_m")] == ["office", None, None, None, None]


def test_path_in_a_base_file_is_relative_to_that_file(tmp_path):
    (tmp_path / "scenarios").mkdir()
    (tmp_path / "scenarios" / "mine.building.yaml").write_text((bundled_folder("networks") / "office" / "office.building.yaml").read_text())
    (tmp_path / "scenarios" / "base.yaml").write_text("map: mine.building.yaml\nrobots: {count: 2}\n")
    file = suite(tmp_path, "base: scenarios/base.yaml\ngrid_search: {seed: 0..1}\n")
    assert columns(runs_of(file, "1"))[0]["map"] == "scenarios/mine.building.yaml"


@pytest.mark.parametrize(
    ("text", "output"),
    [
        ("base: office_5\ngrid_serch: {seed: 0..1}\n", "study.yaml:2: grid_serch: unknown key (did you mean 'grid_search'?)"),
        ("base: office_5\n", "study.yaml: grid_search: nothing to vary; give lists by key, or repeat"),
        ("base: office_6\nrepeat: 2\n", "study.yaml:1: base: office_6: no such file (did you mean 'office_"),
        (
            "base: office_5\ngrid_search:\n  robots.cuont: [1]\n",
            "study.yaml:3: grid_search.robots.cuont: unknown key (did you mean 'robots.count'?)",
        ),
        ("base: office_5\ngrid_search: {seed: []}\n", "study.yaml:2: grid_search.seed: an empty list: give at least one value"),
        ("base: office_5\ngrid_search: {seed: 9..0}\n", "study.yaml:2: grid_search.seed: the range 9..0 is empty"),
        (
            "base: office_5\ngrid_search: {seed: many}\n",
            "study.yaml:2: grid_search.seed: found 'many', expected a list, such as [many], or a range, such as 0..53",
        ),
        (
            "base: office_5\ngrid_search:\n  seed: [0]\n  planner: [cbs, cbss]\n",
            "study.yaml:4: grid_search.planner: unknown planner 'cbss' (did you mean 'cbs'?)",
        ),
        (
            "base: office_5\ngrid_search:\n  map: [office, ofice]\n",
            "study.yaml:3: grid_search.map: no map 'ofice': neither a file nor a bundled map (did you mean 'office'?)",
        ),
        (
            "base: office_5\ngrid_search:\n  planner.parameters: [{bypass: false}, {bypas: false}]\n",
            "study.yaml:3: grid_search.planner.parameters: planner 'cbs': unknown parameter 'bypas' (did you mean 'bypass'?)",
        ),
        ("base: office_5\ngrid_search:\n  seed: [-1]\n", "study.yaml:3: grid_search.seed: found -1, expected 0 or more"),
        ("base: {map: office, robots: {cont: 5}}\nrepeat: 2\n", "study.yaml:1: base.robots.cont: unknown key (did you mean 'count'?)"),
        ("base: office_5\ngrid_search: {seed: 0..3}\nexclude: [{seed: 9}]\n", "study.yaml:3: exclude[0]: no run has these values"),
        (
            "base: office_5\ngrid_search: {seed: 0..3}\nexclude: [{seeed: 9}]\n",
            "study.yaml:3: exclude[0].seeed: unknown key (did you mean 'seed'?)",
        ),
        (
            "base: office_5\ngrid_search: {seed: 0..3}\nexclude: [{planner: []}]\n",
            "study.yaml:3: exclude[0].planner: an empty list: give at least one value",
        ),
        ("base: office_5\ngrid_search: {seed: 0..3}\nexclude: [{seed: 0..3}]\n", "study.yaml:3: exclude: nothing is left to run"),
        (
            "base: office_5\ngrid_search: {planner.name: [cbs], planner: [pibt]}\n",
            "study.yaml:2: grid_search.planner: would undo 'planner.name' above it; put it first",
        ),
        (
            "base: office_5\ngrid_search: {seed: 0..1999, repeat: [1]}\n",
            "study.yaml:2: grid_search.repeat: unknown key (known: ",
        ),
        ("base: office_5\ngrid_search: {seed: 0..999, robots.count: 1..9999}\n", "study.yaml: 9999000 runs, expected at most 1000000"),
    ],
)
def test_fault_of_a_suite_is_one_line_with_its_place(tmp_path, text, output):
    with pytest.raises(ScenarioError) as error:
        runs_of(suite(tmp_path, text), "1")
    assert str(error.value).startswith(output)
    assert len(str(error.value).splitlines()) == 1


def test_every_fault_of_an_axis_is_told_at_once(tmp_path):
    file = suite(tmp_path, "base: office_5\ngrid_search:\n  execution.policy: [adgg, adg]\n  planner: [cbs, cbss, ecbss]\n")
    with pytest.raises(ScenarioError) as error:
        runs_of(file, "1")
    assert len(error.value.lines) >= 1
    assert all(line.startswith("study.yaml:") for line in error.value.lines)


@pytest.mark.slow
@pytest.mark.parametrize("path", SUITES, ids=lambda path: path.stem)
def test_bundled_suite_has_runs(path):
    file = read_suite(find_suite(path.stem))
    assert file.suite.description
    assert runs_of(file, code_version())


def test_unknown_suite_is_told_with_the_nearest():
    with pytest.raises(ScenarioError, match=r"no suite 'paper_comparisn'.*did you mean 'paper_comparison'"):
        find_suite("paper_comparisn")


def test_code_version_is_stable():
    assert code_version() == code_version()


@pytest.mark.campaign
def test_hundred_thousand_runs_can_be_planned(tmp_path):
    file = suite(tmp_path, "base: office_5\ngrid_search: {robots.count: [1, 2], seed: 0..49999}\n")
    assert len(runs_of(file, "1")) == 100_000
