"""Walls as cells."""

import pytest

from mrp_sumo.errors import MapError
from mrp_sumo.maps.costmap import costmap
from mrp_sumo.maps.readers.rmf.building_yaml import building_of
from mrp_sumo.maps.yaml_text import parse, read_text

WALL = """
name: room
coordinate_system: cartesian_meters
levels:
  L1:
    vertices: [[0, 0, 0, a], [2, 0, 0, b]]
    walls: [[0, 1, {}]]
"""


@pytest.fixture
def building(tmp_path):
    path = tmp_path / "room.building.yaml"
    path.write_text(WALL)
    text = read_text(path)
    return building_of(parse(text), text)


def test_a_wall_is_ten_centimetres_thick(building):
    result = costmap(building, "L1")
    assert result.origin_m == (-0.5, -0.5)
    assert result.occupied.shape == (20, 60)  # half a metre around
    assert result.occupied[:, 30].nonzero()[0].tolist() == [9, 10]  # y from -0.05 to 0.05
    assert result.occupied[9].nonzero()[0][[0, -1]].tolist() == [9, 50]  # x from -0.05 to 2.05: centres within 0.05 m of the wall's axis


def test_unknown_levels_are_refused(building):
    with pytest.raises(MapError, match=r"no level 'L2' \(known: L1\)"):
        costmap(building, "L2")
