"""Names that files give."""

import pytest

from mrp_sumo.errors import MapError
from mrp_sumo.files.names import fault_of, fault_of_folder
from mrp_sumo.maps.load import load_map


@pytest.mark.parametrize("name", ["", "dock 4", "a/b", "..", "Tür <1>", "x" * 200])
def test_name_that_can_be_shown_is_taken(name):
    assert fault_of(name) == ""


@pytest.mark.parametrize("name", ["a\nb", "\x1b[31m", "\x00", "x" * 201, "ü" * 101])
def test_name_with_control_characters_or_too_long_is_refused(name):
    assert fault_of(name)
    assert "\n" not in fault_of(name)


@pytest.mark.parametrize("name", [".", "..", "a/b", "a\nb", "x" * 201])
def test_name_that_is_no_folder_is_refused(name):
    assert fault_of_folder(name)


def test_map_whose_vertex_has_such_a_name_is_refused_in_one_line(tmp_path):
    path = tmp_path / "two.building.yaml"
    path.write_text(
        "name: two\nlevels:\n  L1:\n    elevation: 0\n    vertices:\n    - [0, 0, 0, 'a']\n    - [100, 0, 0, \"b\\e[31m\"]\n"
        "    lanes:\n    - [0, 1, {bidirectional: [4, true], graph_idx: [2, 0]}]\n"
        "    measurements:\n    - [0, 1, {distance: [3, 5.0]}]\n"
    )
    with pytest.raises(MapError, match=r"two\.building\.yaml.*control characters"):
        load_map(path)
