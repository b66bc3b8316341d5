"""ROS occupancy maps."""

import numpy as np
import pytest
from PIL import Image

from mrp_sumo.errors import MapError
from mrp_sumo.maps.load import load_map

SHEET = "image: room.pgm\nresolution: 0.1\norigin: [-1.0, 2.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\nmode: trinary\n"


@pytest.fixture
def room(tmp_path):
    """12 x 8 pixels of 0.1 m, free but for a pillar in the lower left corner and an unknown column on the right."""
    pixels = np.full((8, 12), 254, np.uint8)
    pixels[-1, 0] = 0
    pixels[:, -1] = 205
    Image.fromarray(pixels).save(tmp_path / "room.pgm")
    path = tmp_path / "room.yaml"
    path.write_text(SHEET)
    return path


def test_cells_where_the_robot_fits_are_vertices_in_the_maps_frame(room):
    result = load_map(room, cell_m=0.4, robot_radius_m=0.15)
    # three columns, two rows; the pillar is 0.16 m from the first centre, the unknown column 0.10 m from the last two
    assert result.nav.xy.round(9).tolist() == [[-0.8, 2.2], [-0.4, 2.2], [-0.8, 2.6], [-0.4, 2.6]]
    assert result.nav.num_edges == 4
    assert result.free.tolist() == [[True, True, False], [True, True, False]]


def test_thin_walls_between_cells_keep_them_apart(room):
    pixels = np.full((4, 12), 254, np.uint8)
    pixels[:, 4] = 0  # between the first and the second cell
    Image.fromarray(pixels).save(room.with_name("room.pgm"))
    graph = load_map(room, cell_m=0.4, robot_radius_m=0.1).nav
    assert sorted(zip(graph.tail.tolist(), graph.head.tolist())) == [(1, 2), (2, 1)]


def test_png_with_transparency_and_negation(room):
    pixels = np.zeros((4, 8, 4), np.uint8)
    pixels[..., 3] = 255
    pixels[:, 4:, 3] = 0  # see-through: unknown
    Image.fromarray(pixels).save(room.with_name("room.png"))
    room.write_text(SHEET.replace("room.pgm", "room.png").replace("negate: 0", "negate: 1"))
    assert load_map(room, cell_m=0.2, robot_radius_m=0.05).nav.num_vertices == 4


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("room.pgm", "hall.pgm", "room.yaml:1: image 'hall.pgm' is not there"),
        ("room.pgm", "room.yaml", "image 'room.yaml' cannot be read"),
        ("0.1\n", "fine\n", "room.yaml:2: resolution is fine, expected a number"),
        ("0.1\n", "0x1F\n", "room.yaml:2: resolution is 31 m, expected metres a pixel, above 0 and at most 5"),
        ("0.0]", "1.5]", "origin has a yaw of 1.5: turn the image instead"),
        ("trinary", "raw", "mode is 'raw', expected trinary or scale"),
        ("0.1\n", "0.001\n", "the map is smaller than a cell of 0.4 m"),
    ],
)
def test_broken_sheets_are_refused(room, old, new, message):
    room.write_text(SHEET.replace(old, new))
    with pytest.raises(MapError) as error:
        load_map(room)
    assert message in str(error.value)


def test_a_robot_that_fits_nowhere_is_refused(room):
    with pytest.raises(MapError, match="no place where a robot of radius 5 m can stand"):
        load_map(room, robot_radius_m=5)
