"""Notes about drawings, one each on a small building."""

import pytest

from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.oddities import oddities

LANE = "{graph_idx: [2, 0], bidirectional: [4, true]}"


def notes(tmp_path, vertices, lanes, more="", lifts="{}"):
    path = tmp_path / "odd.building.yaml"
    drawn = ", ".join(f"[{a}, {b}, {LANE}]" for a, b in lanes)
    path.write_text(
        f"name: odd\ncoordinate_system: cartesian_meters\nlifts: {lifts}\n"
        f"levels:\n  L1:\n    vertices: {vertices}\n    lanes: [{drawn}]\n{more}"
    )
    return oddities(load_map(path).building)


def test_a_plain_corner_is_not_odd(tmp_path):
    assert notes(tmp_path, "[[0, 0, 0, a], [5, 0, 0, b], [5, 5, 0, c]]", [(0, 1), (1, 2)], "    walls: [[0, 2, {}]]\n") == ()


def test_lanes_on_each_other(tmp_path):
    result = notes(tmp_path, "[[0, 0, 0, a], [5, 0, 0, b], [9, 0.2, 0, c], [0, 5, 0, d]]", [(0, 1), (3, 0), (2, 0)])
    assert result == ("level L1: lanes 0 and 2 leave a vertex less than 3 degrees apart",)


def test_vertices_almost_at_one_place(tmp_path):
    result = notes(tmp_path, "[[0, 0, 0, a], [5, 0, 0, b], [5.03, 0, 0, c], [9, 3, 0, d]]", [(0, 1), (2, 3)])
    assert result == ("level L1: vertices 1 and 2 are 0.030 m apart and not connected; --snap joins them",)


DOORS = "    doors: [[2, 3, {name: [1, in], type: [1, hinged]}], [4, 5, {name: [1, NAME], type: [1, hinged]}]]\n"
PLACES = "[[0, 0, 0, a], [9, 0, 0, b], [2, -1, 0, ''], [2, 1, 0, ''], [6, -1, 0, ''], [6, 1, 0, ''], [4, -2, 0, ''], [4, 2, 0, '']]"


def test_a_lane_through_two_doors(tmp_path):
    result = notes(tmp_path, PLACES, [(0, 1)], DOORS.replace("NAME", "out"))
    assert result == ("level L1: lane 0 goes through doors in, out; the nav graph knows the last one in the file",)


@pytest.mark.parametrize(
    ("name", "note"),
    [("in", "2 doors are named 'in'; the nav graph knows the last one"), ("'null'", "1 of 2 doors without a name")],
)
def test_doors_that_cannot_be_told_apart(tmp_path, name, note):
    assert notes(tmp_path, PLACES, [(0, 6)], DOORS.replace("NAME", name))[-1] == f"level L1: {note}"


def test_a_lane_through_a_wall_but_not_beside_a_door(tmp_path):
    walls = "    walls: [[2, 3, {}], [6, 7, {}]]\n"
    assert notes(tmp_path, PLACES, [(0, 1)], walls) == ("level L1: lane 0 goes through walls 0, 1",)
    door = "    doors: [[2, 3, {name: [1, in], type: [1, hinged]}]]\n"
    assert notes(tmp_path, PLACES, [(0, 1)], walls + door) == ("level L1: lane 0 goes through wall 1",)


def test_two_lifts_at_one_place(tmp_path):
    lift = "x: {}, y: 0, yaw: 0, width: 2, depth: 2, level_doors: {{L1: [d]}}"
    lifts = f"{{old: {{{lift.format(3)}}}, new: {{{lift.format(3.2)}}}, far: {{{lift.format(30)}}}}}"
    result = notes(tmp_path, "[[0, 0, 0, a], [5, 0, 0, b]]", [(0, 1)], lifts=lifts)
    assert result[-1] == "lifts 'old' and 'new' are at one place; 'old' serves its vertices"


def test_a_lift_that_stops_where_no_vertex_is_in_it_and_doors_on_no_lane(tmp_path):
    lifts = "{lift: {x: 30, y: 0, yaw: 0, width: 2, depth: 2, level_doors: {L1: [d], L9: [d]}}}"
    doors = "    doors: [[2, 3, {name: [1, gate]}]]\n"
    result = notes(tmp_path, "[[0, 0, 0, a], [5, 0, 0, b], [2, 3, 0, c], [3, 3, 0, d]]", [(0, 1)], doors, lifts=lifts)
    assert result == (
        "level L1: no lane leads through 1 of 1 doors, such as 'gate'",
        "lift 'lift' stops at level L1, where no vertex of a lane is in it: robots cannot use it there",
        "lift 'lift' stops at 'L9', which is no level (known: L1)",
    )
