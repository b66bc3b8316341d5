"""Furniture: models whose size a scenario knows are walls."""

import numpy as np
import pytest

from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.errors import MapError
from mrp_sumo.maps.clearance import narrow, standing_walls
from mrp_sumo.maps.furniture import with_furniture
from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.map import unused

ROOM = """
name: room
levels:
  L1:
    vertices: [[0, 0, 0, a], [100, 0, 0, b]]
    measurements: [[0, 1, {distance: [3, 10]}]]
    lanes: [[0, 1, {graph_idx: [2, 0], bidirectional: [4, true]}]]
    models:
      - {model_name: Table, name: t1, static: true, x: 50, y: 12, yaw: 1.5707963, z: 0}
      - {model_name: Chair, name: c1, static: true, x: 80, y: 3, yaw: 0, z: 0}
lifts: {}
"""
CART = RobotType("cart", 0.6, 0.6, 1.0, 1.0, 1.0, 1.0)


def test_a_table_is_as_long_as_the_scenario_says_along_its_own_x(tmp_path):
    path = tmp_path / "room.building.yaml"
    path.write_text(ROOM)
    map_ = load_map(path)
    assert not len(standing_walls(map_.building, ["L1"]))
    result = with_furniture(map_, {"Table": (2.0, 0.8)})
    walls = standing_walls(result.building, ["L1"]) + result.building.origin_m
    np.testing.assert_allclose(walls.min((0, 1)), (4.6, -2.2), atol=1e-6)  # turned by a right angle, around (5, -1.2)
    np.testing.assert_allclose(walls.max((0, 1)), (5.4, -0.2), atol=1e-6)
    assert narrow(result.nav, result.building, CART).lane_m.tolist() == pytest.approx([0.2, 0.2])
    assert (unused(map_), unused(result)) == ("not used: models: 2", "not used: models: 1")


def test_furniture_that_is_not_there_is_named_with_the_nearest(tmp_path):
    path = tmp_path / "room.building.yaml"
    path.write_text(ROOM)
    with pytest.raises(MapError, match=r"^'Tabel' is no model of 'room' \(did you mean 'Table'\?\)$"):
        with_furniture(load_map(path), {"Tabel": (1.0, 1.0)})
