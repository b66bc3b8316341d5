"""Scenario files: what is read, and the line a person gets for each fault."""

from dataclasses import asdict

import pytest

from mrp_sumo.core.disturbances import NAMED_DISTURBANCES, Disturbances
from mrp_sumo.core.robot_type import RobotShape
from mrp_sumo.errors import ScenarioError
from mrp_sumo.io.columns import put
from mrp_sumo.io.scenario.file import find_scenario
from mrp_sumo.io.scenario.model import ScenarioModel
from mrp_sumo.io.scenario.read import changed, read_scenario, scenario_of
from mrp_sumo.io.scenario.robots import robot_type

GOOD = """\
map: office
robots:
  count: 3
planner:
  name: cbs
"""


def written(tmp_path, text, name="case.yaml"):
    path = tmp_path / name
    path.write_text(text)
    return path


def lines_for(tmp_path, text):
    with pytest.raises(ScenarioError) as caught:
        read_scenario(written(tmp_path, text))
    return str(caught.value).splitlines()


def test_short_forms_and_defaults(tmp_path):
    scenario = read_scenario(written(tmp_path, GOOD)).scenario
    assert scenario.map.file == "office"
    assert scenario.name == "case"
    assert (scenario.planner.time_limit_s, scenario.execution.time_limit_s) == (60.0, None)
    assert (scenario.discretisation.kind, scenario.discretisation.cell_m) == ("auto", 0.4)


def test_number_of_robots_alone_stands_for_their_count(tmp_path):
    assert read_scenario(written(tmp_path, "map: office\nrobots: 3\n")).scenario.robots.count == 3
    assert lines_for(tmp_path, "map: office\nrobots: yes\n") == [
        "case.yaml:2: robots: found True, expected a number of robots, such as 4, or keys and values"
    ]
    assert lines_for(tmp_path, "map: office\nrobots: 0\n") == ["case.yaml:2: robots.count: found 0, expected 1 or more"]


def test_scenario_needs_no_file(tmp_path):
    file = scenario_of({"map": "office", "robots": 3}, tmp_path, "mine")
    assert (file.scenario.name, file.folder) == ("mine", tmp_path)
    with pytest.raises(ScenarioError, match=r"^scenario: planer: unknown key \(did you mean 'planner'\?\)$"):
        scenario_of({"map": "office", "robots": 3, "planer": "cbs"}, tmp_path, "mine")


def test_changed_scenario_keeps_its_name_and_blames_the_option(tmp_path):
    file = read_scenario(written(tmp_path, GOOD, "two words.yaml"))
    other = changed(file, {("planner", "name"): ("--planner", "pibt")})
    assert (other.scenario.name, other.scenario.planner.name, file.scenario.planner.name) == ("two words", "pibt", "cbs")
    with pytest.raises(ScenarioError, match=r"^--seed: found -1, expected 0 or more$"):
        changed(other, {("seed",): ("--seed", -1)})


def test_a_map_may_be_united_and_repaired(tmp_path):
    text = "map: {file: site, graph: [0, 2], snap_m: 0.15, split_crossings: true, largest_component: true}\nrobots: {count: 2}\n"
    chosen = read_scenario(written(tmp_path, text)).scenario.map
    assert (chosen.graph, chosen.snap_m, chosen.split_crossings, chosen.largest_component) == ((0, 2), 0.15, True, True)


def test_every_fault_is_one_line_with_its_line_number(tmp_path):
    assert lines_for(tmp_path, "map: {file: office, grph: 0}\nrobots:\n  count: 0\nplaner: cbs\nexecution: 3\n") == [
        "case.yaml:1: map.grph: unknown key (did you mean 'graph'?)",
        "case.yaml:3: robots.count: found 0, expected 1 or more",
        "case.yaml:5: execution: found 3, expected keys and values",
        "case.yaml:4: planer: unknown key (did you mean 'planner'?)",
    ]


def test_an_anchor_may_be_given_twice_as_yaml_has_it(tmp_path):
    text = "map: &a office\nseed: &a 3\nrobots: *a\n"
    assert read_scenario(written(tmp_path, text)).scenario.robots.count == 3


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", "case.yaml: found nothing, expected keys and values"),
        ("[1, 2]", "case.yaml: found a list of 2, expected keys and values"),
        ("map: a\nmap: b\n", "case.yaml:2: key 'map' is given twice"),
        ("map: [\n", "case.yaml:2: not YAML: did not find expected node content"),
        (GOOD + "  time_limit_s: 0\n", "case.yaml:6: planner.time_limit_s: found 0, expected greater than 0"),
        (GOOD + "  time_limit_s: .nan\n", "case.yaml:6: planner.time_limit_s: found nan, expected a finite number"),
        (
            "map: {file: office, graph: first}\nrobots: {count: 1}\n",
            "case.yaml:1: map.graph: found 'first', expected a number from 0 to 9, a list of them, or 'all'",
        ),
        (
            GOOD + "discretisation: {kind: grid, lanes: two_way}\n",
            "case.yaml:6: discretisation: lanes: two_way is for kind roadmap; lanes of a grid are two cells wide already",
        ),
        ("map: office\nrobots: {}\n", "case.yaml:2: robots: give count, or starts and goals"),
        ("map: office\nrobots: {count: 2, type: 3}\n", "case.yaml:2: robots.type: found 3, expected text or keys and values"),
        (
            "map: office\nrobots: {count: 2, type: {length_m: 1, decel_mps2: 2}}\n",
            "case.yaml:2: robots.type.width_m, max_speed_mps, accel_mps2: missing",
        ),
        (GOOD + "  retime: {margin_s: x}\n", "case.yaml:6: planner.retime.margin_s: found 'x', expected a number of seconds"),
        (
            GOOD + "execution: {disturbances: {latency_s: 1.0e+308}}\n",
            "case.yaml:6: execution.disturbances: latency_s is 1e+308, expected at most 1e+09",
        ),
        (GOOD + "seed: yes\n", "case.yaml:6: seed: found True, expected a whole number"),
        (GOOD + "execution: {step_length_s: true}\n", "case.yaml:6: execution.step_length_s: found True, expected a number of seconds"),
        (
            "map: office\nrobots: {fleet: [{type: amr_600, count: on}]}\n",
            "case.yaml:2: robots.fleet[0].count: found True, expected a whole number",
        ),
        ("map: office\nrobots: [{type: amr_600, count: on}]\n", "case.yaml:2: robots[0].count: found True, expected a whole number"),
        (GOOD + "seed: 1.0e+308\n", "case.yaml:6: seed: found 1e+308, expected a whole number"),
        (GOOD + "record: {storage: MCAP}\n", "case.yaml:6: record.storage: unknown value 'MCAP' (did you mean 'mcap'?)"),
        (
            "map: office\nrobots: {starts: desk}\ntasks: {list: [{stops: [v1, v2]}]}\n",
            "case.yaml:2: robots.starts: found 'desk', expected a list",
        ),
        (GOOD + "people: {lane_speeds: []}\n", "case.yaml:6: people.lane_speeds[0]: missing"),
        ("map: office\nrobots: {starts: [a]}\n", "case.yaml:2: robots: starts and goals go together: give both or neither"),
        (
            "map: office\nrobots: {count: 2, draw: uniforn}\n",
            "case.yaml:2: robots.draw: unknown value 'uniforn' (did you mean 'uniform'?)",
        ),
    ],
)
def test_fault_reads_well(tmp_path, text, line):
    assert lines_for(tmp_path, text) == [line]


def test_missing_file_names_the_nearest(tmp_path):
    written(tmp_path, GOOD, "office_9.yaml")
    with pytest.raises(ScenarioError, match=r"ofice_9.yaml: no such file \(did you mean 'office_9.yaml'\?\)"):
        read_scenario(tmp_path / "ofice_9.yaml")


def test_a_folder_with_one_scenario_in_it_names_that(tmp_path):
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "scenario.yaml").write_text("map: office\n")
    with pytest.raises(ScenarioError, match=r"site is a folder, expected a file \(did you mean '.*site/scenario.yaml'\?\)"):
        find_scenario(str(tmp_path / "site"))
    (tmp_path / "site" / "other.yaml").write_text("map: office\n")
    with pytest.raises(ScenarioError, match=r"site is a folder, expected a file$"):
        find_scenario(str(tmp_path / "site"))


def test_a_name_that_no_system_takes_is_no_file():
    with pytest.raises(ScenarioError, match="no such file"):
        find_scenario("a" * 5000)


def test_missing_file_names_the_nearest_of_any_kind_beside_it(tmp_path):
    (tmp_path / "Demo-01.xml").touch()
    with pytest.raises(ScenarioError, match=r"Demo-01.xm: no such file \(did you mean 'Demo-01.xml'\?\)"):
        find_scenario(str(tmp_path / "Demo-01.xm"))


def test_binary_file_is_refused(tmp_path):
    path = tmp_path / "case.yaml"
    path.write_bytes(b"map: \xff\xfe")
    with pytest.raises(ScenarioError, match="not a text file in UTF-8"):
        read_scenario(path)


def test_command_line_overrides_are_checked_and_named(tmp_path):
    path = written(tmp_path, GOOD)
    file = read_scenario(path, {("seed",): ("--seed", 7), ("robots", "count"): ("--robots", 5)})
    assert (file.scenario.seed, file.scenario.robots.count) == (7, 5)
    assert file.at("robots", "count") == "--robots"
    assert file.at("planner", "name") == "case.yaml:5: planner.name"
    with pytest.raises(ScenarioError, match=r"^--robots: found -1, expected 1 or more$"):
        read_scenario(path, {("robots", "count"): ("--robots", -1)})


def test_a_figure_of_a_named_type_is_that_of_the_type_written_out(tmp_path):
    (tmp_path / "mine.yaml").write_text("{length_m: 1, width_m: 1, max_speed_mps: 1, accel_mps2: 1, decel_mps2: 1, turn_rate_rad_s: 1}")
    file = read_scenario(written(tmp_path, "map: office\nrobots: {count: 2, type: mine.yaml}\n"))
    slow = changed(file, {("robots", "type", "max_speed_mps"): ("--set", 0.4), ("robots", "type", "gap_m"): ("--set", 0.2)}).scenario.robots
    assert slow.type == RobotShape(length_m=1, width_m=1, max_speed_mps=0.4, accel_mps2=1, decel_mps2=1, turn_rate_rad_s=1, gap_m=0.2)
    assert file.scenario.robots.type == "mine.yaml"
    with pytest.raises(ScenarioError, match=r"unknown key \(did you mean 'max_speed_mps'\?\)$"):
        changed(file, {("robots", "type", "max_sped_mps"): ("--set", 1)})


def test_robot_types(tmp_path):
    written(tmp_path, "length_m: 1\nwidth_m: 1\nmax_speed_mps: 1\naccel_mps2: 1\ndecel_mps2: 1\nturn_rate_rad_s: 1\n", "big.yaml")
    assert robot_type("big", tmp_path, tmp_path).name == "big"
    shape = RobotShape(length_m=1, width_m=1, max_speed_mps=1, accel_mps2=1, decel_mps2=1, turn_rate_rad_s=1)
    assert robot_type(shape, tmp_path, tmp_path).gap_m == 0.1
    with pytest.raises(ScenarioError, match="did you mean 'big'"):
        robot_type("bigg", tmp_path, tmp_path)


@pytest.mark.parametrize(
    ("intervals", "says"),
    [
        ("{max_speed: [1, 2]}", r"intervals.max_speed is no figure that is given here \(did you mean 'max_speed_mps'\?\)"),
        ("{max_speed_mps: [1.1, 2]}", "intervals.max_speed_mps is 1.1 to 2, expected low and high around max_speed_mps, 1"),
        ("{mttr_h: [1, 2]}", "intervals.mttr_h is no figure that is given here"),
        ("{max_speed_mps: 1}", "cart.yaml:7: intervals.max_speed_mps: found 1, expected a list"),
    ],
)
def test_intervals_hold_figures_that_are_given(tmp_path, intervals, says):
    shape = "length_m: 1\nwidth_m: 1\nmax_speed_mps: 1\naccel_mps2: 1\ndecel_mps2: 1\nturn_rate_rad_s: 1\nintervals: "
    written(tmp_path, f"{shape}{{max_speed_mps: [0.9, 1]}}\n", "cart.yaml")
    assert robot_type("cart", tmp_path, tmp_path).intervals == {"max_speed_mps": (0.9, 1.0)}
    written(tmp_path, f"{shape}{intervals}\n", "cart.yaml")
    with pytest.raises(ScenarioError, match=says):
        robot_type("cart", tmp_path, tmp_path)


def test_schema_describes_every_key():
    schema = ScenarioModel.model_json_schema()
    assert set(schema["properties"]) == set(ScenarioModel.model_fields)
    assert schema["$defs"]["PlannerChoice"]["properties"]["time_limit_s"]["default"] == 60.0


@pytest.mark.parametrize("value", [".nan", ".inf", "1e999"])
def test_numbers_that_are_not_finite_are_refused_wherever_they_stand(tmp_path, value):
    text = GOOD + f"execution:\n  disturbances:\n    speed_noise: {value}\n    obstacles: [{{x_m: 1, y_m: 2, begin_s: {value}}}]\n"
    lines = lines_for(tmp_path, text)
    assert [line.split(": ")[:2] for line in lines] == [
        ["case.yaml:8", "execution.disturbances.speed_noise"],
        ["case.yaml:9", "execution.disturbances.obstacles[0].begin_s"],
    ]


def test_name_of_a_set_stands_for_its_disturbances_which_other_keys_change(tmp_path):
    text = "map: office\nrobots: 2\nexecution: {disturbances: %s}\n"
    short = read_scenario(written(tmp_path, text % "nav2_like")).scenario.execution.disturbances
    assert short.speed_noise == NAMED_DISTURBANCES["nav2_like"]["speed_noise"] > 0
    assert short == Disturbances(**asdict(short))  # as a run folder keeps it
    more = read_scenario(written(tmp_path, text % "{name: nav2_like, speed_noise: 0.2, seed: 7}")).scenario.execution.disturbances
    assert (more.speed_noise, more.seed) == (0.2, 7)
    assert lines_for(tmp_path, text % "nav_like") == [
        "case.yaml:3: execution.disturbances: 'nav_like' is no named set of disturbances (did you mean 'nav2_like'?)"
    ]


def test_another_set_of_disturbances_drops_the_values_of_the_one_before():
    data = {"execution": {"disturbances": {"speed_noise": 0.0, "stops_per_s": 0.1}}}
    put(data, ["execution", "disturbances"], "nav2_like")
    assert data["execution"]["disturbances"] == {"name": "nav2_like"}
