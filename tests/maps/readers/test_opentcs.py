"""openTCS's plant models."""

from pathlib import Path

import numpy as np
import pytest
from map_worlds import MODEL

from mrp_sumo.errors import MapError
from mrp_sumo.maps.load import load_map

DEMO = Path(__file__).resolve().parents[4] / "shared" / "reference" / "data" / "opentcs" / "Demo-01.xml"


@pytest.fixture
def load(tmp_path):
    def loaded(text):
        path = tmp_path / "plant.xml"
        path.write_text(text)
        return load_map(path)

    return loaded


def test_points_paths_locations_and_blocks_are_read_in_metres(load):
    nav = load(MODEL).nav
    p1, p2, p3 = (nav.vertex_of_name[name] for name in ("P1", "P2", "P3"))
    assert nav.xy[[p1, p2, p3]].tolist() == [[0, 0], [4, 0], [4, 4]]
    assert nav.vertex_options[p1] == {"theta_rad": pytest.approx(np.pi / 2), "mutex": "B"}
    assert nav.vertex_options[p2] == {"is_parking_spot": True}
    assert nav.vertex_options[p3] == {"station": "Socket", "actions": "CHARGE", "is_charger": True}
    assert nav.vertex_of_name["Socket"] == p3
    there, back = nav.lane_between(p1, p2), nav.lane_between(p2, p1)
    assert nav.speed_mps[[there, back]].tolist() == [1.5, 0.3]
    assert nav.lane_options[back]["orientation_constraint"] == "backward"
    assert nav.lane_between(p3, p2) < 0  # it is locked
    curved = [k for k, options in enumerate(nav.lane_options) if options["path"] == "P2 --- P3"]
    assert len(curved) > 4
    assert all(nav.lane_options[k]["mutex"] == "B" for k in curved)
    assert nav.xy[:, 0].max() == pytest.approx(4 + 2 * 0.75, abs=0.02)  # of the curve, at its middle


def test_lengths_that_differ_from_the_drawing_are_reported(load):
    found = {finding.kind: finding.details for finding in load(MODEL).findings}
    assert [detail.split(",")[0] for detail in found["path_length_disagrees"]] == ["'P2 --- P3': 9.00 m"]
    assert "locked_path" in found


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('destinationPoint="P2"', 'destinationPoint="P9"', "plant.xml: line 6: destinationPoint of path 'P1 --- P2': no point 'P9'"),
        ('positionX="4000"', 'positionX="4 m"', "plant.xml:4: positionX of <point> is '4 m', expected a number"),
        ('positionX="4000"', 'positionx="4000"', "plant.xml:4: <point> has no 'positionX' (there is 'positionx'?)"),
        ('name="P2" ', 'name="P1" ', "plant.xml:4: the name 'P1' is taken by line 3"),
        ("<model version", '<!DOCTYPE model [<!ENTITY a "b">]><model version', "plant.xml:2: a document type or an entity"),
        ("</model>", "", "not XML: no element found"),
        ('encoding="UTF-8"?>\n<model version="7', 'encoding="P1"?>\n<model name="x" version="7', "not XML: duplicate attribute"),
        ('type="HALT_POSITION"/>', 'type="HALT_POSITION">' + "<a>" * 40, "nested deeper than 30 elements"),
    ],
)
def test_broken_models_are_refused_with_the_line(load, old, new, message):
    assert old in MODEL
    with pytest.raises(MapError) as error:
        load(MODEL.replace(old, new, 1))
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.skipif(not DEMO.is_file(), reason="openTCS's demonstration is not beside this repository")
def test_the_demonstration_of_opentcs_has_its_59_points_and_75_paths():
    nav = load_map(DEMO).nav
    assert sum(bool(name) for name in nav.vertex_name) == 59
    assert len({options["path"] for options in nav.lane_options}) == 75
    assert nav.num_components == 1
    assert nav.xy[nav.vertex_of_name["Goods in north 01"]].tolist() == [-24.0, 11.0]
