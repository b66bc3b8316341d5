"""Benchmark instances become problems."""

import pytest
from golden import INSTANCES

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.formats.instances import read_instance

MAP = "type octile\nheight 2\nwidth 3\nmap\n...\n.@.\n"
SCEN = "version 1\n0\tu.map\t3\t2\t0\t1\t2\t1\t4\n0\tu.map\t3\t2\t2\t0\t0\t0\t2\n"
GRID = """
map: {dimensions: [3, 2], obstacles: [[1, 1]]}
agents:
- {name: a, start: [0, 1], goal: [2, 1]}
- {name: b, start: [2, 0], goal: [0, 0]}
"""
ROADMAP = """
roadmap:
  undirected: false
  vertices: {a: [0, 0], b: [1, 0], c: [2, 0]}
  edges: [[a, b], [b, c], [c, c]]
agents:
- {name: x, start: a, goal: c}
"""


@pytest.fixture
def write(tmp_path):
    def write(name, text):
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return write


def test_scen_and_yaml_say_the_same(write):
    one = read_instance(write("u.map", MAP), write("u.scen", SCEN))
    two = read_instance(write("u.yaml", GRID))
    for instance in (one, two):
        problem, cells = instance.problem, instance.cells
        assert [(cells.column[v], cells.row[v]) for v in (*problem.start, *problem.target)] == [(0, 1), (2, 0), (2, 1), (0, 0)]
        assert problem.graph.num_vertices == 5
        assert problem.graph.num_edges == 4


def test_roadmap_keeps_its_directions_and_names(write):
    problem = read_instance(write("r.yaml", ROADMAP)).problem
    assert problem.graph.lane_between(0, 1) >= 0
    assert problem.graph.lane_between(1, 0) < 0
    assert problem.graph.label(int(problem.start[0])) == "a"


def test_potential_goals_are_left_to_be_assigned(write):
    text = GRID.replace("goal: [2, 1]", "potentialGoals: [[2, 1], [0, 0]]").replace("goal: [0, 0]", "potentialGoals: [[2, 1], [0, 0]]")
    problem = read_instance(write("u.yaml", text)).problem
    assert not problem.is_assigned
    assert len(problem.goal) == 2


def test_starts_and_goals_are_drawn_without_a_scen(write):
    path = write("u.map", MAP)
    one, two = (read_instance(path, None, 3, seed=5).problem for _ in range(2))
    assert (one.start == two.start).all() and (one.goal == two.goal).all()


@pytest.mark.parametrize(
    ("name", "text", "scen", "robots", "says"),
    [
        ("u.map", MAP, SCEN.replace("0\t1\t2\t1", "1\t1\t2\t1"), None, r"u.scen: robot_0 starts at cell \(1, 1\), which is blocked"),
        ("u.map", MAP, SCEN.replace("2\t0\t0\t0\t2\n", "0\t1\t0\t0\t2\n"), None, "robot_0 and robot_1 both start"),
        ("u.map", MAP, SCEN, 3, "u.scen has 2 robots, 3 are wanted"),
        ("u.map", MAP, SCEN, -1, "-1 robots"),
        ("u.map", MAP, SCEN.replace("\t3\t2\t", "\t4\t2\t"), None, "for a map of 4 x 2"),
        ("u.map", MAP, None, None, "number of robots is missing"),
        ("u.yaml", GRID.replace("[2, 1]", "[1, 1]"), None, None, r"robot_0 goes to cell \(1, 1\), which is blocked"),
        ("u.yaml", GRID.replace("[3, 2]", "[3]"), None, None, "expected \\[width, height\\]"),
        ("u.yaml", GRID.replace("goal: [2, 1]", "gaol: [2, 1]"), None, None, r"agents\[0\] has no start"),
        ("r.yaml", ROADMAP.replace("goal: c", "goal: d"), None, None, "robot_0 goes to 'd', which is not a vertex"),
        ("r.yaml", ROADMAP.replace("[b, c]", "[b, e]"), None, None, r"roadmap.edges\[1\]"),
        ("u.yaml", "levels: {}", None, None, "neither a MovingAI map nor"),
    ],
)
def test_flawed_instances_are_refused_in_one_line(write, name, text, scen, robots, says):
    with pytest.raises(MrpSumoError, match=says) as error:
        read_instance(write(name, text), write("u.scen", scen) if scen else None, robots)
    assert "\n" not in str(error.value)


def test_benchmark_instance_is_read():
    instance = read_instance(INSTANCES / "warehouse_0.4.map", INSTANCES / "warehouse_0.4_n9_s3000.scen", 9)
    assert instance.problem.graph.num_vertices == 788
    cells, start = instance.cells, instance.problem.start
    rows = (INSTANCES / "warehouse_0.4_n9_s3000.scen").read_text().splitlines()[1:]
    assert [(cells.column[v], cells.row[v]) for v in start] == [tuple(map(int, row.split()[4:6])) for row in rows]


@pytest.mark.parametrize(
    "text",
    [
        GRID.replace("dimensions: [3, 2]", "dimensions: [99999, 99999]"),
        GRID.replace("[[1, 1]]", "[[1, 99999999999999999999]]"),
        ROADMAP.replace("a: [0, 0]", "a: [.nan, 0]"),
        ROADMAP.replace("a: [0, 0]", "a: [" + "9" * 400 + ", 0]"),
    ],
)
def test_numbers_beyond_range_are_refused_in_a_line(write, text):
    with pytest.raises(MrpSumoError) as caught:
        read_instance(write("u.yaml", text))
    assert len(str(caught.value).splitlines()) == 1


def test_height_of_five_thousand_digits_is_refused(write):
    with pytest.raises(MrpSumoError, match="height is '9999"):
        read_instance(write("u.map", MAP.replace("height 2", "height " + "9" * 5000)), None, 1)


def test_obstacles_that_are_no_list_are_refused(tmp_path):
    path = tmp_path / "instance.yaml"
    path.write_text("map:\n  dimensions: [4, 3]\n  obstacles: 7\nagents:\n- {name: a, start: [0, 0], goal: [3, 0]}\n")
    with pytest.raises(MrpSumoError, match=r"map\.obstacles has 7, expected a list"):
        read_instance(path)


def test_dimensions_that_are_no_numbers_are_refused(tmp_path):
    path = tmp_path / "instance.yaml"
    path.write_text("map:\n  dimensions: [4, true]\n  obstacles: []\nagents:\n- {name: a, start: [0, 0], goal: [3, 0]}\n")
    with pytest.raises(MrpSumoError, match=r"map\.dimensions is"):
        read_instance(path)
