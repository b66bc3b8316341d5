"""The outline of a building as a run folder keeps it."""

import json

import numpy as np
import pytest

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.io.outline import outline_of, read_outline, write_outline
from mrp_sumo.maps.catalogue import find_map
from mrp_sumo.maps.load import load_map


def test_outline_is_read_back_to_the_millimetre(tmp_path):
    map_ = load_map(find_map("office", tmp_path))
    outline = outline_of(map_.building, map_.nav.level_names)
    write_outline(tmp_path / "building.json", outline)
    back = read_outline(tmp_path / "building.json")
    assert np.abs(back.walls - outline.walls).max() <= 5e-4 + 1e-9
    assert len(back.walls) > 50
    assert [len(f) for f in back.floors] == [len(f) for f in outline.floors]
    assert read_outline(tmp_path / "none.json") is None


@pytest.mark.parametrize("x_m", [1e308, float("nan")])
def test_coordinates_of_no_building_are_refused(tmp_path, x_m):
    path = tmp_path / "building.json"
    path.write_text(json.dumps({"schema_version": 1, "walls": [[[0, 0], [x_m, 1]]], "doors": [], "floors": [], "holes": [], "lifts": []}))
    with pytest.raises(MrpSumoError, match="a coordinate beyond"):
        read_outline(path)
