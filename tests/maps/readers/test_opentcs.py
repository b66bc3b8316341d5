"""openTCS's plant models."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from map_worlds import MODEL

from mrp_sumo.core.robot_type import Loaded, RobotType, Wheels
from mrp_sumo.errors import MapError
from mrp_sumo.io.map_files import write_map
from mrp_sumo.maps.load import load_map

DATA = Path(__file__).resolve().parents[2] / "data" / "formats"
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
    result = {finding.kind: finding.details for finding in load(MODEL).findings}
    assert [detail.split(",")[0] for detail in result["path_length_disagrees"]] == ["'P2 --- P3': 9.00 m"]
    assert "locked_path" in result


def test_empty_model_has_nothing_to_drive_on(load):
    with pytest.raises(MapError, match=r"no lanes: nothing to drive on \(0 vertices\)"):
        load('<model version="0.0.2" name="unnamed"/>')


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('destinationPoint="P2"', 'destinationPoint="P9"', "plant.xml: line 6: destinationPoint of path 'P1 --- P2': no point 'P9'"),
        ('positionX="4000"', 'positionX="4 m"', "plant.xml:4: positionX of <point> is '4 m', expected a number"),
        ('positionX="4000"', 'positionx="4000"', "plant.xml:4: <point> has no 'positionX' (there is 'positionx'?)"),
        ('name="P2" ', 'name="P1" ', "plant.xml:4: the name 'P1' is taken by line 3"),
        ("<model version", '<!DOCTYPE model [<!ENTITY a "b">]><model version', "plant.xml:2: a document type with declarations"),
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


def old(text, version):
    """The model as openTCS wrote it before version 6: other names of coordinates, and before 0.0.4 what is drawn in the `visualLayout`."""
    text = text.replace("positionX", "xPosition").replace("positionY", "yPosition").replace("positionZ", "zPosition")
    text = text.replace('version="7.0.0"', f'version="{version}"')
    if version in ("0.0.4", "0.0.5"):
        return text
    return text.replace(
        '<pathLayout connectionType="BEZIER" layerId="0"><controlPoint x="120" y="0"/><controlPoint x="120" y="-80"/></pathLayout>', ""
    ).replace(
        '<visualLayout name="V" scaleX="50.0" scaleY="50.0"/>',
        '<visualLayout name="V" scaleX="50.0" scaleY="50.0"><modelLayoutElement visualizedObjectName="P2 --- P3" layer="0">'
        '<property name="CONN_TYPE" value="BEZIER"/><property name="CONTROL_POINTS" value="120,0;120,-80"/>'
        "</modelLayoutElement></visualLayout>",
    )


def same(nav, other):
    return (
        nav.xy.tolist() == other.xy.tolist()
        and nav.vertex_name == other.vertex_name
        and nav.vertex_options == other.vertex_options
        and nav.tail.tolist() == other.tail.tolist()
        and nav.head.tolist() == other.head.tolist()
        and nav.lane_options == other.lane_options
    )


@pytest.mark.parametrize("version", ["0.0.2", "0.0.3", "0.0.4", "0.0.5"])
def test_a_model_is_the_same_in_all_versions(load, version):
    assert same(load(old(MODEL, version)).nav, load(MODEL).nav)
    assert "unknown_version" not in {finding.kind for finding in load(old(MODEL, version)).findings}


def test_what_old_models_say_and_is_not_read_is_reported(load):
    def reported(text):
        return [f.details for f in load(text).findings if f.kind == "old_model_in_part"]

    costly = old(MODEL, "0.0.2").replace('length="4000"', 'length="4000" routingCost="7"', 1)
    assert reported(costly.replace("</model>", '<group name="G"/></model>')) == [
        ("version '0.0.2', without its groups (1), the routing costs of 4 paths",)
    ]
    assert reported(old(MODEL, "0.0.2").replace('locked="', 'routingCost="1" locked="')) == []  # what openTCS writes where nobody set one


LAYOUT = """<visualLayout name="V" scaleX="50.0" scaleY="50.0">
    <modelLayoutElement visualizedObjectName="P1" layer="0">
        <property name="POSITION_X" value="0"/><property name="POSITION_Y" value="0"/>
    </modelLayoutElement>
    <modelLayoutElement visualizedObjectName="P2" layer="0">
        <property name="POSITION_X" value="2000"/><property name="POSITION_Y" value="0"/>
    </modelLayoutElement>
    <modelLayoutElement visualizedObjectName="P1 --- P2" layer="0">
        <property name="CONN_TYPE" value="POLYPATH"/><property name="CONTROL_POINTS" value="20,-20"/>
    </modelLayoutElement>
</visualLayout>"""
TWO = """<?xml version="1.0"?><model version="0.0.2" name="two">
    <point name="P1" xPosition="{}" yPosition="{}" zPosition="0" type="HALT_POSITION"/>
    <point name="P2" xPosition="{}" yPosition="{}" zPosition="0" type="HALT_POSITION"/>
    <path name="P1 --- P2" sourcePoint="P1" destinationPoint="P2" length="4000" maxVelocity="1000" maxReverseVelocity="0" locked="false"/>
    {}</model>"""


@pytest.mark.parametrize(
    ("ends", "bend"),
    [
        ((0, 0, 2000, 0), (1, 1)),  # as it is drawn
        ((0, 0, 4000, 0), (2, 2)),  # twice as large
        ((5000, 0, 5000, 2000), (4, 1)),  # elsewhere, and turned to the left
        ((0, 0, 0, 0), (1, 1)),  # nowhere: it lies as it is drawn
    ],
)
def test_a_curve_joins_the_points_of_the_model_wherever_the_layout_has_them(load, ends, bend):
    loaded = load(TWO.format(*ends, LAYOUT))
    assert loaded.nav.xy[2].tolist() == pytest.approx(bend)
    assert ("places_of_the_layout" in {f.kind for f in loaded.findings}) == (ends == (0, 0, 0, 0))


@pytest.mark.parametrize(("points", "noted"), [("20,-20", False), ("20;-20", True), ("x,1", True), ("1e99,0", True), ("", False)])
def test_control_points_that_are_none_make_a_path_straight_and_are_reported(load, points, noted):
    loaded = load(TWO.format(0, 0, 2000, 0, LAYOUT.replace("20,-20", points)))
    assert ("trajectory_unusable" in {f.kind for f in loaded.findings}) == noted
    assert loaded.nav.num_vertices == (3 if points == "20,-20" else 2)


def test_the_demonstration_of_opentcs_4_20_is_read():
    nav = load_map(DATA / "opentcs" / "Demo-01_4.20.xml").nav
    assert sum(bool(name) for name in nav.vertex_name) == 55
    assert len({options["path"] for options in nav.lane_options}) == 68
    assert nav.num_components == 1
    assert nav.xy[nav.vertex_of_name["Point-0001"]].tolist() == pytest.approx([53.288, -3.893])
    bends = nav.xy[[v for v, options in enumerate(nav.vertex_options) if options.get("is_bend")]]
    named = nav.xy[[v for v, name in enumerate(nav.vertex_name) if name]]
    assert (bends.min(0) > named.min(0) - 2).all()  # curves are among the points that they join, which are drawn some 25 m elsewhere
    assert (bends.max(0) < named.max(0) + 2).all()


@pytest.mark.skipif(not DEMO.is_file(), reason="openTCS's demonstration is not beside this repository")
def test_the_demonstration_of_opentcs_has_its_59_points_and_75_paths():
    nav = load_map(DEMO).nav
    assert sum(bool(name) for name in nav.vertex_name) == 59
    assert len({options["path"] for options in nav.lane_options}) == 75
    assert nav.num_components == 1
    assert nav.xy[nav.vertex_of_name["Goods in north 01"]].tolist() == [-24.0, 11.0]


@pytest.mark.parametrize(
    ("vehicles", "expected"),
    [
        ('<vehicle name="a" length="1200" maxVelocity="800"/>', (1.2, None, 0.8)),  # before version 6
        ('<vehicle name="a" maxVelocity="800"><boundingBox length="1200" width="500"/></vehicle>', (1.2, 0.5, 0.8)),
        ('<vehicle name="b" length="900" maxVelocity="800"/><vehicle name="a" length="1200" maxVelocity="500"/>', (1.2, None, 0.5)),
        ('<vehicle name="a" length="1200"/>', None),
        ("", None),
    ],
)
def test_the_longest_vehicle_of_which_size_and_speed_are_known_is_read(load, vehicles, expected):
    known = load(MODEL.replace("</model>", f"{vehicles}</model>"))
    vehicle = known.longest_vehicle
    assert len(known.vehicles) == vehicles.count("<vehicle ")
    assert (vehicle and (vehicle.length_m, vehicle.width_m, vehicle.max_speed_mps)) == expected
    assert vehicle is None or vehicle.name == "a"


def test_types_of_robots_become_vehicles_with_envelopes_and_come_back(load, tmp_path):
    figures = {"length_m": 1.5, "width_m": 0.8, "max_speed_mps": 1.0, "accel_mps2": 0.5, "decel_mps2": 0.5, "gap_m": 0.3}
    wheels = {"kind": "tricycle", "wheelbase_m": 1.0, "steering_max_rad": 1.0}
    robots = (
        RobotType("turns", **figures, turn_rate_rad_s=0.5, loaded=Loaded(length_m=1.8)),
        RobotType("backs", **figures, kinematics=Wheels(**wheels, reverse=True, reverse_mps=0.4)),
        RobotType("ahead", **figures, kinematics=Wheels(**wheels)),
    )
    path = tmp_path / "written.xml"
    write_map(load(MODEL), path, robots=robots)
    vehicles = {each.name: each for each in load_map(path).vehicles}
    assert {name: (each.length_m, each.width_m, each.max_speed_mps, each.reverse_mps) for name, each in vehicles.items()} == {
        "turns": (1.5, 0.8, 1.0, 1.0),
        "backs": (1.5, 0.8, 1.0, 0.4),
        "ahead": (1.5, 0.8, 1.0, 0.0),
    }
    for robot in robots:
        assert vehicles[robot.name].clear_m == pytest.approx(robot.radius_m + 0.15, abs=1e-3)  # written in whole millimetres
    root = ElementTree.parse(path).getroot()
    assert root.find("point/maxVehicleBoundingBox").get("length") == "1800"  # with its load
    assert [child.tag for child in root.find("point")][:4] == ["maxVehicleBoundingBox", *["vehicleEnvelope"] * 3]  # as the schema orders
    assert [child.tag for child in root.find("path")] == [*["vehicleEnvelope"] * 3, "pathLayout"]
    tags = [child.tag for child in root]
    assert tags == sorted(tags, key=["point", "path", "vehicle", "locationType", "location", "block", "visualLayout"].index)


def test_envelope_along_a_path_is_as_wide_as_at_its_points(load, tmp_path):
    robot = RobotType("cart", 0.6, 0.8, max_speed_mps=1.0, accel_mps2=1.0, decel_mps2=1.0, turn_rate_rad_s=1.0, gap_m=0.2)
    map_ = load(MODEL)
    write_map(map_, tmp_path / "written.xml", robots=(robot,))
    root = ElementTree.parse(tmp_path / "written.xml").getroot()
    at = {point.get("name"): np.array([float(point.get(key)) for key in ("positionX", "positionY")]) for point in root.iter("point")}
    straight = [path for path in root.iter("path") if path.find("pathLayout").get("connectionType") == "DIRECT"]
    assert straight
    for path in straight:
        a, b = at[path.get("sourcePoint")], at[path.get("destinationPoint")]
        corners = np.array([[float(v.get("x")), float(v.get("y"))] for v in path.iter("vertex")])
        along = (b - a) / np.hypot(*(b - a))
        reach = (corners - a) @ along
        aside = (corners - a) @ (-along[1], along[0])
        least = 1000 * (robot.radius_m + 0.1)
        for far in (-aside.min(), aside.max(), -reach.min(), reach.max() - np.hypot(*(b - a))):
            assert least - 1 <= far <= 1.03 * least
