"""Buildings made of maps of other formats."""

from pathlib import Path

import numpy as np
import pytest

from mrp_sumo.maps.building_file import building_document
from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.yaml_edit import text_of

PROJECT = Path(__file__).resolve().parents[2]


def test_a_map_of_any_format_becomes_a_drawing_of_the_same_size(tmp_path):
    plant = load_map(PROJECT / "networks" / "plant" / "plant.lif.json")
    path = tmp_path / "plant.building.yaml"
    path.write_text(text_of(building_document(plant)))
    again = load_map(path)
    assert (again.nav.num_vertices, again.nav.num_lanes) == (plant.nav.num_vertices, plant.nav.num_lanes)
    assert np.sort(again.nav.length_m) == pytest.approx(
        np.sort(np.hypot(*(plant.nav.xy[plant.nav.head] - plant.nav.xy[plant.nav.tail]).T)), abs=1e-3
    )
    assert np.isfinite(again.nav.speed_mps).sum() == np.isfinite(plant.nav.speed_mps).sum()


def test_levels_stay_on_each_other(tmp_path):
    hospital = load_map(PROJECT / "networks" / "hospital_levels" / "hospital_levels.building.yaml")
    path = tmp_path / "copy.building.yaml"
    path.write_text(text_of(building_document(hospital)))
    again = load_map(path).building
    for name, level in hospital.building.levels.items():
        assert np.sort(again.levels[name].wall_xy[:, 0], axis=0).shape == np.sort(level.wall_xy[:, 0], axis=0).shape
        own, other = (building.levels[name].world_xy[building.levels[name].walls].reshape(-1, 2) for building in (again, hospital.building))
        assert np.ptp(own, axis=0) == pytest.approx(np.ptp(other, axis=0), abs=5e-3)
