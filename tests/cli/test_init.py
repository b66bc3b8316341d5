"""`mrp-sumo init MAP`: what it writes runs, says what it guessed, and replaces nothing."""

import shlex

import numpy as np
import pytest
import yaml

from mrp_sumo.cli.main import main
from mrp_sumo.core.graph import nav_graph
from mrp_sumo.core.task import CHARGE, ORDER, log_of_times
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.proposal import spread, stands_still, stations_of
from mrp_sumo.maps.catalogue import bundled_folder
from mrp_sumo.maps.roadmap import cut_lanes

SHOP = """name: shop
coordinate_system: cartesian_meters
levels:
  L1:
    vertices:
      - [0, 0, 0, counter, {pickup_dispenser: [1, d]}]
      - [4, 0, 0, ""]
      - [8, 0, 0, table, {dropoff_ingestor: [1, i]}]
      - [4, 4, 0, nest, {is_charger: [4, true]}]
      - [4, -4, 0, corner, {is_parking_spot: [4, true]}]
      - [40, 40, 0, island]
      - [44, 40, 0, beach]
    lanes:
      - [0, 1, {bidirectional: [4, true], graph_idx: [2, 0]}]
      - [1, 2, {bidirectional: [4, true], graph_idx: [2, 0]}]
      - [1, 3, {bidirectional: [4, true], graph_idx: [2, 0]}]
      - [1, 4, {bidirectional: [4, true], graph_idx: [2, 0]}]
      - [5, 6, {bidirectional: [4, true], graph_idx: [2, 0]}]
"""
KINEMATIC = ("--set", "execution.engine=kinematic", "--set", "record.bag=false", "--set", "execution.time_limit_s=60")


@pytest.fixture
def shop(tmp_path, monkeypatch):
    """A folder with a map, in which commands are called."""
    (tmp_path / "shop.building.yaml").write_text(SHOP)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_what_the_map_says_is_taken_and_runs(shop, capsys):
    assert main(["init", "shop.building.yaml", "--type", "turtlebot3"]) == 0
    said = capsys.readouterr().out
    text = (shop / "shop" / "scenario.yaml").read_text()
    scenario = yaml.safe_load(text)
    assert scenario["tasks"]["groups"] == {"pick": ["counter"], "drop": ["table"], "charger": ["nest"], "parking": ["corner"]}
    assert scenario["tasks"]["streams"][0]["stops"] == ["pick", "drop"] and scenario["tasks"]["charging"]["stations"] == ["charger"]
    assert scenario["map"]["file"] == "../shop.building.yaml" and "# guessed: " in text
    commands = [line.removeprefix("next:").strip() for line in said.splitlines() if "mrp-sumo " in line and not line.startswith("your")]
    assert [command.split()[1] for command in commands] == ["run", "capacity", "replay"]
    assert main([*shlex.split(commands[0])[1:], *KINEMATIC]) == 0  # and the folder that the third one names is that of the first
    assert main(shlex.split(commands[2])[1:-1]) == 0


def test_listed_orders_are_driven_as_printed(shop, capsys):
    assert main(["init", "shop.building.yaml", "--type", "turtlebot3", "--robots", "1", "--orders", "3", "--out", "a b"]) == 0
    said = capsys.readouterr().out
    assert (shop / "a b" / "orders.csv").read_text().splitlines()[:2] == ["name,release_s,stops", "order_0,0,counter table"]
    line = next(line for line in said.splitlines() if line.startswith("your orders"))
    assert main([*shlex.split(line.partition("then mrp-sumo ")[2]), *KINEMATIC[:4]]) == 0


def test_the_five_questions_are_answered_or_guessed(shop, monkeypatch):
    answers = iter(["turtlebot3", "2", "", "5", "0.5"])
    monkeypatch.setattr("builtins.input", lambda _: next(answers))
    assert main(["init", "shop.building.yaml", "--interactive"]) == 0
    scenario = yaml.safe_load((shop / "shop" / "scenario.yaml").read_text())
    assert (scenario["robots"], scenario["execution"]["time_limit_s"]) == ({"count": 2, "type": "turtlebot3"}, 1800)
    assert scenario["tasks"]["streams"][0]["service"] == [{"constant_s": 5}]


@pytest.mark.parametrize(("length_mm", "fits"), [(1200, True), (9000, False)])
def test_the_vehicle_that_an_opentcs_model_lists_is_taken_where_two_of_it_fit(tmp_path, length_mm, fits, monkeypatch, capsys):
    model = (bundled_folder("networks") / "plant" / "plant.xml").read_text()
    vehicles = "".join(f'<vehicle name="tug {i}" length="{length_mm}" maxVelocity="800"/>' for i in (1, 2, 3))
    (tmp_path / "hall.xml").write_text(model.replace("</model>", f"{vehicles}</model>"))
    monkeypatch.chdir(tmp_path)
    assert main(["init", "hall.xml"]) == 0
    robots = yaml.safe_load((tmp_path / "hall" / "scenario.yaml").read_text())["robots"]
    assert robots["count"] == 3
    if fits:
        assert (robots["type"]["length_m"], robots["type"]["width_m"], robots["type"]["max_speed_mps"]) == (1.2, 0.84, 0.8)
        assert "3 robots of 1.2 x 0.84 m and 0.8 m/s" in capsys.readouterr().out
    else:
        assert robots["type"] == "forklift"


@pytest.mark.parametrize(("first_m", "robots"), [(0.7, "turtlebot3"), (1.0, "amr_600")])  # two of 0.6 x 0.6 m need 0.95 m
def test_a_type_of_which_one_alone_fits_is_not_proposed_where_two_smaller_ones_do(tmp_path, first_m, robots, monkeypatch):
    (tmp_path / "shop.building.yaml").write_text(SHOP.replace("[4, 0, 0, ", f"[{first_m}, 0, 0, "))
    monkeypatch.chdir(tmp_path)
    assert main(["init", "shop.building.yaml"]) == 0
    assert yaml.safe_load((tmp_path / "shop" / "scenario.yaml").read_text())["robots"]["type"] == robots


@pytest.mark.slow
def test_on_a_floor_without_names_places_lie_far_apart_and_large_robots_that_cover_it_are_proposed(tmp_path, monkeypatch):
    """A hall of 8 x 8 m with a nook of 0.6 x 0.6 m, whose cells are of 0.4 m for small robots and of 0.95 m for larger ones."""
    pixels = np.zeros((160, 160), np.uint8)
    pixels[4:-16, 4:-4] = 254
    pixels[-16:-4, 80:92] = 254
    (tmp_path / "hall.pgm").write_bytes(b"P5 160 160 255\n" + pixels.tobytes())
    (tmp_path / "hall.yaml").write_text("image: hall.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n")
    monkeypatch.chdir(tmp_path)
    assert main(["init", "hall.yaml"]) == 0
    text = (tmp_path / "hall" / "scenario.yaml").read_text()
    scenario = yaml.safe_load(text)
    assert scenario["robots"]["type"] == "amr_600" and scenario["discretisation"]["kind"] == "grid"
    assert len(scenario["tasks"]["groups"]["place"]) == 24 and "cells far apart from each other, as the map names no places" in text


def test_spread_places_are_each_the_farthest_from_those_before():
    xy = np.array([[0.0, 0], [1, 0], [2.1, 0], [10, 0]])
    assert spread(xy, 3) == [0, 2, 3]  # 0, then 10, then 2.1, which is 2.1 from 0
    assert spread(xy, 9) == [0, 1, 2, 3]


def test_orders_come_as_robots_that_drive_as_fast_as_each_lane_allows_can_do_a_quarter_of_the_time(shop):
    slow = SHOP.replace("- [1, 3, {", "- [1, 3, {speed_limit: [3, 0.01], ")  # to the charger: no order goes there
    (shop / "slow.building.yaml").write_text(slow)
    rates = []
    for name in ("shop", "slow"):
        assert main(["init", f"{name}.building.yaml", "--type", "turtlebot3", "--robots", "1"]) == 0
        rates.append(yaml.safe_load((shop / name / "scenario.yaml").read_text())["tasks"]["streams"][0]["arrivals"]["rate_per_h"])
    assert rates[0] == rates[1] == pytest.approx(0.25 * 3600 / (2 * 8 / 0.22 + 2 * 20), rel=0.05)  # 8 m from counter to table


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["none.building.yaml"], "no map 'none.building.yaml'"),
        (["shop.building.yaml", "--type", "forklif"], "'forklif' is neither a robot type nor a file (did you mean 'forklift'?)"),
        (["shop.building.yaml", "--robots", "99"], "99 robots, but 'shop' has"),
        (["shop.building.yaml", "--rate", "0"], "--rate: found 0, expected"),
        (["shop.building.yaml", "--orders", "0"], "--orders: found 0, expected"),
        (["shop.building.yaml", "--out", "shop.building.yaml"], "is there already, and may be yours"),
        (["shop.building.yaml", "--out", "shop.building.yaml/new"], "is a file, expected a folder"),
        (["one.building.yaml"], "fewer than two stations"),
        (["shop.building.yaml", "--type", "car.yaml"], "there is nothing to carry; car cannot reverse, from 'v10' to 'v1' and back"),
        (["office_5"], "no map 'office_5'"),
    ],
)
def test_what_cannot_be_made_is_one_line_and_leaves_nothing(shop, capsys, arguments, line):
    wheels = "{kind: ackermann, wheelbase_m: 0.2, steering_max_rad: 1.2}"
    figures = {"length_m": 0.3, "width_m": 0.2, "max_speed_mps": 1, "accel_mps2": 1, "decel_mps2": 1, "kinematics": wheels}
    (shop / "car.yaml").write_text("".join(f"{key}: {value}\n" for key, value in figures.items()))
    (shop / "one.building.yaml").write_text(SHOP.partition("    lanes:")[0] + "    lanes: [[1, 3, {graph_idx: [2, 0]}]]\n")
    before = sorted(path.name for path in shop.iterdir())
    code = main(["init", *arguments])
    said = capsys.readouterr().err
    assert (code, said.count("\n")) == (2, 1), said
    assert line in said and sorted(path.name for path in shop.iterdir()) == before


def test_a_scenario_that_is_there_is_left_alone(shop, capsys):
    (shop / "shop").mkdir()
    (shop / "shop" / "scenario.yaml").write_text("mine")
    assert main(["init", "shop.building.yaml"]) == 2
    assert "may be yours" in capsys.readouterr().err and (shop / "shop" / "scenario.yaml").read_text() == "mine"


@pytest.mark.parametrize(
    ("names", "options", "role"),
    [
        (["Goods in", "x", "y"], [{}, {}, {}], {"pick": ("Goods in",), "place": ("x", "y")}),
        (["unload_1", "load_1", "y"], [{}, {}, {}], {"drop": ("unload_1",), "pick": ("load_1",), "place": ("y",)}),
        (["a", "b", "c"], [{"is_parking_spot": True}] * 3, {"place": ("a", "b", "c")}),  # parking alone is no work: they are stations
        (["a", "b", "c"], [{"is_parking_spot": True}, {}, {}], {"parking": ("a",), "place": ("b", "c")}),
        (["p", "q", "r"], [{"station": "Storage 01", "actions": "Unload cargo"}, {"station": "Out", "actions": "Drop"}, {}],
         {"place": ("Storage 01",), "drop": ("Out",)}),  # of maps with stations mere points are none; storage is loaded and unloaded
        (["Ladestation", "b", "c"], [{}, {}, {}], {"charger": ("Ladestation",), "place": ("b", "c")}),
        (["", "", ""], [{}, {}, {}], {"place": ("v0", "v2")}),  # the ends
    ],
)  # fmt: skip
def test_places_are_for_what_the_map_says_else_their_names(names, options, role):
    nav = nav_graph(
        name="row", xy=[(0, 0), (4, 0), (8, 0)], lanes=[(0, 1), (1, 0), (1, 2), (2, 1)], vertex_name=names, vertex_options=options
    )
    stations = stations_of(nav, cut_lanes(nav, 0.4))
    assert {key: value for key, value in vars(stations).items() if value} == role


def test_places_that_robots_do_not_come_to_and_from_are_told():
    """`source` has no way in, `trap` none out, and `far` is on another piece; of a station with two places one is enough."""
    nav = nav_graph(
        name="row",
        xy=[(0, 0), (4, 0), (8, 0), (12, 0), (16, 0), (20, 0), (24, 0)],
        lanes=[(1, 2), (2, 1), (0, 1), (2, 3), (4, 5), (5, 4)],
        vertex_name=["source", "a", "b", "trap", "far", "", "lone"],
        vertex_options=[{}, {}, {}, {"is_charger": True}, {}, {}, {"is_passthrough_point": True}],
    )
    stations = stations_of(nav, cut_lanes(nav, 0.4))
    assert (stations.place, stations.charger, stations.unreached) == (("a", "b"), (), ("source", "trap", "far"))
    assert "unreached" not in stations.groups


@pytest.mark.parametrize(("side_m", "asks"), [(900.0, False), (1100.0, True)])
def test_a_map_that_may_be_in_millimetres_is_asked_about(tmp_path, monkeypatch, capsys, side_m, asks):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "row.csv").write_text(f"from,to,from_x_m,from_y_m,to_x_m,to_y_m,both_ways\na,b,0,0,{side_m},0,yes\n")
    monkeypatch.setattr("mrp_sumo.experiments.proposal._fault", lambda *_: "")  # how it drives is not the question
    assert main(["init", "row.csv", "--type", "amr_600"]) == 0
    assert ("is the file in millimetres?" in capsys.readouterr().err) == asks


def test_out_may_name_the_file(shop, capsys):
    assert main(["init", "shop.building.yaml", "--type", "turtlebot3", "--out", "sites/first.yaml"]) == 0
    assert [path.name for path in (shop / "sites").iterdir()] == ["first.yaml"]
    assert "next: mrp-sumo run sites/first.yaml" in capsys.readouterr().out
    assert yaml.safe_load((shop / "sites" / "first.yaml").read_text())["map"]["file"] == "../shop.building.yaml"
    assert main(["init", "shop.building.yaml", "--out", "sites/first.yaml"]) == 2
    assert "sites/first.yaml: is there already" in capsys.readouterr().err


@pytest.mark.slow
def test_robots_that_would_stand_in_each_others_way_for_good_are_not_proposed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    places = "".join(f"      - [{4 * k}, 0, 0, place_{k}]\n" for k in range(4))  # in a row, on a single track
    lanes = "".join(f"      - [{k}, {k + 1}, {{bidirectional: [4, true], graph_idx: [2, 0]}}]\n" for k in range(3))
    levels = f"levels:\n  L1:\n    vertices:\n{places}    lanes:\n{lanes}"
    (tmp_path / "row.building.yaml").write_text(f"name: row\ncoordinate_system: cartesian_meters\n{levels}")
    assert main(["init", "row.building.yaml", "--type", "amr_600"]) == 0
    text = (tmp_path / "row" / "scenario.yaml").read_text()
    assert "count: 1  # fewer than guessed first, as 2 did not get on" in text
    assert main(["init", "row.building.yaml", "--type", "amr_600", "--robots", "2", "--out", "two"]) == 2
    assert capsys.readouterr().err.endswith("; try fewer --robots\n") and not (tmp_path / "two").exists()


@pytest.mark.parametrize(
    ("released_s", "done_s", "stands"),
    [
        ([299, 400], [np.nan, np.nan], True),
        ([301, 400], [np.nan, np.nan], False),
        ([10, 400], [np.nan, 590], False),
    ],
)
def test_fleet_that_does_no_order_in_three_times_what_one_takes_stands_still(released_s, done_s, stands):
    """An order takes 100 s, the trial 600 s. What charges is no order."""
    released, done, never = np.array([*released_s, 0.0]), np.array([*done_s, 100.0]), np.full(3, np.nan)
    tasks = log_of_times(("a", "b", "c"), np.zeros(3, np.int64), released, never, never, done, (ORDER, ORDER, CHARGE))
    assert stands_still(tasks, 100.0) == stands


def test_a_scenario_that_cannot_be_written_leaves_nothing(shop, monkeypatch, capsys):
    def write(path, text):
        raise MrpSumoError(f"{path.name}: cannot be written: the disk is full")

    monkeypatch.setattr("mrp_sumo.cli.init.write_text", write)
    assert main(["init", "shop.building.yaml", "--type", "turtlebot3"]) == 2
    assert capsys.readouterr().err == "mrp-sumo: scenario.yaml: cannot be written: the disk is full\n"
    assert [path.name for path in shop.iterdir()] == ["shop.building.yaml"]
