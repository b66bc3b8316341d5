"""Finding maps."""

import pytest

from mrp_sumo.errors import MapError
from mrp_sumo.maps.catalogue import bundled_maps, find_map


def test_files_beside_the_scenario_come_first(tmp_path):
    (tmp_path / "office").write_text("")
    assert find_map("office", tmp_path) == tmp_path / "office"


def test_bundled_maps_are_found_by_name(tmp_path):
    assert find_map("office", tmp_path) == bundled_maps()["office"]


def test_the_nearest_name_is_offered(tmp_path):
    with pytest.raises(MapError, match=r"no map 'ofice'.*did you mean 'office'"):
        find_map("ofice", tmp_path)
