"""The outline of a building as a run folder keeps it."""

import numpy as np

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
