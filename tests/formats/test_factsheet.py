"""Factsheets of VDA 5050: types there and back, sheets of others, and what is refused."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from mrp_sumo.core.arrivals import ServiceTime
from mrp_sumo.core.robot_type import Actions, Loaded, Wheels
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.formats.vda.factsheet import factsheet_file, is_factsheet, lost, read_factsheet
from mrp_sumo.formats.vda.messages import VERSIONS, Dialect
from mrp_sumo.io.scenario.robots import robot_type
from mrp_sumo.maps.catalogue import bundled_folder

ROBOTS = bundled_folder("robots")
TYPES = sorted(path.stem for path in ROBOTS.glob("*.yaml"))
SCHEMAS = Path(__file__).resolve().parents[3] / "shared" / "reference" / "data" / "vda5050"
FOREIGN = {  # 2.1, of a three-wheeler whose origin is its fixed axle
    "manufacturer": "acme",
    "typeSpecification": {"seriesName": "lifter", "agvKinematic": "THREEWHEEL", "agvClass": "FORKLIFT", "maxLoadMass": 900},
    "physicalParameters": {"speedMax": 1.8, "accelerationMax": 0.6, "decelerationMax": -0.7, "width": 0.8, "length": 2.0},
    "agvGeometry": {
        "wheelDefinitions": [
            {"type": "FIXED", "isActiveSteered": False, "position": {"x": 0, "y": 0.3}},
            {"type": "FIXED", "isActiveSteered": False, "position": {"x": 0, "y": -0.3}},
            {"type": "DRIVE", "isActiveSteered": True, "position": {"x": 1.3, "y": 0}},
            {"type": "CASTER", "isActiveSteered": False, "position": {"x": 1.3, "y": 0.3}},
        ],
        "envelopes2d": [
            {"set": "unloaded", "polygonPoints": [{"x": x, "y": y} for x, y in ((-0.4, 0.4), (1.6, 0.4), (1.6, -0.4), (-0.4, -0.4))]}
        ],
    },
    "loadSpecification": {
        "loadPositions": ["forks"],
        "loadSets": [
            {
                **{"setName": "EPAL", "loadType": "EPAL", "maxWeight": 900, "agvSpeedLimit": 1.2, "pickTime": 20, "dropTime": 15},
                **{"boundingBoxReference": {"x": 0, "y": 0, "z": 0}, "loadDimensions": {"length": 1.2, "width": 1.0}},
            },
            {"setName": "light", "loadType": "box", "maxWeight": 50, "agvSpeedLimit": 1.5, "agvAccelerationLimit": 0.5, "pickTime": 25},
        ],
    },
}


def written(folder, document, name="sheet.json"):
    path = folder / name
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    return path


def bundled(name):
    return robot_type(name, ROBOTS, ROBOTS)


def as_held(robot, is_new):
    """A type with the figures that a factsheet holds; the others as they are by default."""
    loaded = replace(robot.loaded, turn_rate_rad_s=None, mass_kg=None) if robot.loaded else None
    actions = {key: getattr(robot.actions, key) for key in ("pick", "drop")} if robot.actions else {}
    means = {key: ServiceTime(constant_s=pytest.approx(time.mean_s)) for key, time in actions.items() if time is not None}
    rate = robot.turn_rate_rad_s if is_new or robot.turn_rate_rad_s is None else 1.0
    return replace(
        replace(robot, trailers=()),
        **{"battery": None, "gap_m": 0.1, "turn_rate_rad_s": rate, "actions": Actions(**means) if means else None},
        loaded=None if loaded == Loaded() else loaded,
    )


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", TYPES)
def test_type_is_the_same_after_a_factsheet_but_for_what_it_does_not_hold(tmp_path, name, version):
    robot = bundled(name)
    assert robot.loaded is None or robot.loaded.mass_kg is not None  # which no sheet has
    again, _ = read_factsheet(written(tmp_path, factsheet_file(robot, version), f"{name}.json"))
    assert again == as_held(robot, version == "3.0")


@pytest.mark.parametrize("version", VERSIONS)
def test_factsheets_keep_to_the_schema(version):
    jsonschema = pytest.importorskip("jsonschema")
    file = SCHEMAS / version / "json_schemas" / "factsheet.schema"
    if not file.is_file():
        pytest.skip("no schemas here")
    validator = jsonschema.Draft202012Validator(json.loads(file.read_text()))
    for name in TYPES:
        assert not [error.message for error in validator.iter_errors(json.loads(factsheet_file(bundled(name), version)))], name


def test_what_is_lost_is_named():
    truck = bundled("pallet_truck")
    assert lost(truck, Dialect("3.0")) == "gap_m, battery, loaded.mass_kg, actions.pick (but its mean), actions.drop (but its mean)"
    assert lost(bundled("forklift"), Dialect("2.1")).startswith("turn_rate_rad_s, ")
    assert "trailers" in lost(bundled("tugger"), Dialect("3.0"))
    assert lost(replace(bundled("forklift"), battery=None, gap_m=0.1), Dialect("3.0")) == ""


def test_manufacturer_and_series_are_kept(tmp_path):
    named = replace(bundled("forklift"), vehicle_type="acme.fork.2")
    document = json.loads(factsheet_file(named, "3.0"))
    assert (document["manufacturer"], document["typeSpecification"]["seriesName"]) == ("acme", "fork.2")
    assert read_factsheet(written(tmp_path, document))[0].vehicle_type == "acme.fork.2"


def test_accelerations_of_the_body_are_those_with_a_load():
    body = json.loads(factsheet_file(bundled("pallet_truck"), "3.0"))["physicalParameters"]
    assert (body["maximumAcceleration"], body["maximumDeceleration"]) == (0.3, 0.5)


def test_sheet_of_another_maker(tmp_path):
    robot, notes = read_factsheet(written(tmp_path, FOREIGN, "lifter.json"))
    assert robot.name == "lifter"
    assert robot.vehicle_type == "acme.lifter"
    assert (robot.length_m, robot.width_m, robot.max_speed_mps, robot.accel_mps2, robot.decel_mps2) == (2.0, 0.8, 1.8, 0.6, 0.7)
    assert robot.kinematics == Wheels("tricycle", wheelbase_m=1.3, steering_max_rad=1.2, axle_m=0.6)
    # The pallet's middle is on the axle: it reaches from 1.2 m behind the middle of the body to the axle and beyond.
    assert robot.loaded == Loaded(speed_mps=1.2, accel_mps2=0.5, length_m=2.4, width_m=1.0)
    assert robot.actions == Actions(pick=ServiceTime(constant_s=25), drop=ServiceTime(constant_s=15))
    assert robot.max_load_kg == 900
    assert robot.capacity == 1
    assert notes == [
        "guessed: kinematics.steering_max_rad 1.2, which a factsheet has no member for",
        "guessed: kinematics.reverse false, as optionalParameters do not list order.edges.orientation",
        "the strictest limits and longest times of 2 load sets hold for all loads",
    ]


def test_what_a_sheet_does_not_say_is_guessed_and_told(tmp_path):
    bare = {
        "typeSpecification": {"mobileRobotKinematics": "DIFFERENTIAL"},
        "physicalParameters": {"maximumSpeed": 1, "maximumAcceleration": 0, "width": 0.5, "length": 0.7},
    }
    robot, notes = read_factsheet(written(tmp_path, bare))
    assert (robot.accel_mps2, robot.decel_mps2, robot.turn_rate_rad_s) == (0.5, 0.5, 1.0)
    assert [note.split()[1] for note in notes] == ["accel_mps2", "decel_mps2", "turn_rate_rad_s"]
    bare["typeSpecification"]["mobileRobotKinematics"] = "THREE_WHEEL"
    robot, notes = read_factsheet(written(tmp_path, bare))
    assert robot.kinematics.wheelbase_m == 0.49
    assert any("wheelDefinitions has no fixed wheel" in note for note in notes)


def test_body_is_as_large_as_its_envelope_and_not_as_a_notch(tmp_path):
    points = [{"x": x, "y": y} for x, y in ((-1, 0.5), (1, 0.5), (1, 0.1), (0, 0.1), (0, -0.1), (1, -0.1), (1, -0.5), (-1, -0.5))]
    sheet = {
        "typeSpecification": {"mobileRobotKinematics": "OMNIDIRECTIONAL"},
        "physicalParameters": {"maximumSpeed": 1, "maximumAcceleration": 1, "maximumDeceleration": 1, "width": 1.0, "length": 1.8},
        "mobileRobotGeometry": {"envelopes2d": [{"envelope2dId": "all", "vertices": points}]},
    }
    robot, notes = read_factsheet(written(tmp_path, sheet))
    assert (robot.length_m, robot.width_m) == (2.0, 1.0)
    assert notes == [
        "left out: the shape of envelope 'all', of which its length and width are taken",
        "length_m is 2, as the envelope is larger than physicalParameters.length, 1.8",
    ]


def _with(*path, value=None):
    """The foreign sheet with another value at a place, or without it."""
    document = json.loads(json.dumps(FOREIGN))
    holder = document
    for key in path[:-1]:
        holder = holder[key]
    if value is None:
        del holder[path[-1]]
    else:
        holder[path[-1]] = value
    return document


FRONT = ("wheelDefinitions", 2, "position", "x")
BAD = {
    "not_json": ("{", "not JSON"),
    "array": ([1], "found an array of 1, expected an object"),
    "no_body": (_with("physicalParameters"), "no 'physicalParameters'"),
    "no_length": (_with("physicalParameters", "length"), "physicalParameters: no 'length'"),
    "no_speed": (_with("physicalParameters", "speedMax", value=0.0), "physicalParameters.speedMax: found 0, expected more than 0"),
    "text": (_with("physicalParameters", "width", value="80 cm"), "physicalParameters.width: found '80 cm', expected a number"),
    "too_long": (_with("physicalParameters", "length", value=1e5), "length_m is 100000, expected"),
    "kinematics": (_with("typeSpecification", "agvKinematic", value="THREWHEEL"), "did you mean 'THREEWHEEL'"),
    "envelope": (_with("agvGeometry", "envelopes2d", 0, "polygonPoints", value=[]), "found 0 points, expected 3 or more"),
    "wheel": (_with("agvGeometry", *FRONT, value="front"), "wheelDefinitions[2].position.x: found 'front'"),
    "wheelbase": (_with("agvGeometry", *FRONT, value=0), "wheelbase_m is 0"),
    "load_sets": (_with("loadSpecification", "loadSets", value={}), "loadSets: found an object, expected an array"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_sheet_is_refused_in_one_line(tmp_path, name):
    document, expected = BAD[name]
    with pytest.raises(MrpSumoError) as error:
        read_factsheet(written(tmp_path, document, f"{name}.json"))
    assert expected in str(error.value)
    assert f"{name}.json: " in str(error.value)
    assert "\n" not in str(error.value)


def test_factsheet_of_a_log_is_read_too(tmp_path):
    line = json.dumps({"t_s": 0.0, "topic": "uagv/v2/acme/1/factsheet", "payload": FOREIGN})
    for text in (f"{line}\n{line}\n", json.dumps(FOREIGN) + "\n" + json.dumps(FOREIGN)):
        path = written(tmp_path, text, "factsheet.jsonl")
        assert is_factsheet(path)
        assert read_factsheet(path)[0].vehicle_type == "acme.lifter"


def test_factsheets_are_told_from_other_files(tmp_path):
    assert not is_factsheet(written(tmp_path, '{"physicalParameters": ' + "[" * 100_000, "deep.json"))
    assert is_factsheet(written(tmp_path, FOREIGN))
    assert not is_factsheet(written(tmp_path, {"layouts": []}, "a.lif.json"))
    assert not is_factsheet(written(tmp_path, "{", "b.json"))
    assert not is_factsheet(tmp_path / "missing.json")
