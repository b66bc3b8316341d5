"""The folder of a workbench: what is opened comes as a drawing, untouched files keep their bytes, and nobody's work is written over."""

import shutil
from pathlib import Path

import ezdxf
import pytest
from PIL import Image, ImageDraw

from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.io.scenario.robots import robot_type
from mrp_sumo.maps.catalogue import bundled_folder, bundled_maps
from mrp_sumo.studio.findings import check
from mrp_sumo.studio.scenarios import fault_of, fields, values_of, with_value
from mrp_sumo.studio.workspace import Stale, Workspace, lanes_over_floor

ROBOT: RobotType = robot_type("turtlebot3", bundled_folder("robots"), Path())


@pytest.fixture
def folder(tmp_path):
    shutil.copy(bundled_maps()["office"], tmp_path)
    return Workspace(tmp_path.resolve())


def hall(path):
    """30 x 20 m at 5 cm a pixel, with a rack."""
    image = Image.new("RGB", (600, 400), "white")
    ImageDraw.Draw(image).rectangle((0, 0, 599, 399), outline="black", width=3)
    ImageDraw.Draw(image).rectangle((200, 150, 260, 250), fill="black")
    image.save(path)


def draw(path):
    """30 x 20 without a unit: walls, and a table on a layer that is off."""
    drawing = ezdxf.new()
    drawing.header["$INSUNITS"] = 0
    drawing.layers.add("WALLS")
    drawing.layers.add("TABLES").off()
    drawing.modelspace().add_lwpolyline([(0, 0), (30, 0), (30, 20), (0, 20)], close=True, dxfattribs={"layer": "WALLS"})
    drawing.modelspace().add_line((5, 5), (10, 5), dxfattribs={"layer": "TABLES"})
    drawing.saveas(path)


@pytest.mark.parametrize("name", sorted(bundled_maps()))
def test_every_bundled_map_opens_as_a_drawing(tmp_path, name):
    opened = Workspace(tmp_path.resolve()).open(f"bundled:{name}", {})
    assert opened["path"] == f"{name}.building.yaml"
    assert any(level["lanes"] for level in opened["document"]["levels"].values())


def test_a_building_saved_untouched_keeps_its_bytes(folder):
    path = folder.root / "office.building.yaml"
    before = path.read_bytes()
    opened = folder.open(path.name, {})
    assert folder.save_drawing(path.name, opened["document"], opened["digest"]) == opened["digest"]
    assert path.read_bytes() == before


def test_a_moved_vertex_changes_one_line(folder):
    path = folder.root / "office.building.yaml"
    before = path.read_text().splitlines()
    opened = folder.open(path.name, {})
    opened["document"]["levels"]["L1"]["vertices"][3][0] += 1
    folder.save_drawing(path.name, opened["document"], opened["digest"])
    assert sum(a != b for a, b in zip(before, path.read_text().splitlines(), strict=True)) == 1


def test_a_file_that_another_program_changed_is_not_written_over(folder):
    path = folder.root / "office.building.yaml"
    opened = folder.open(path.name, {})
    path.write_text(path.read_text() + "# theirs\n")
    theirs = path.read_bytes()
    with pytest.raises(Stale, match="changed by another program since it was opened: nothing was written"):
        folder.save_drawing(path.name, opened["document"], opened["digest"])
    with pytest.raises(Stale, match="is there already"):
        folder.save_drawing(path.name, opened["document"], "")
    assert path.read_bytes() == theirs


@pytest.mark.parametrize("name", ["../outside.building.yaml", "/etc/passwd", "", "a\0b"])
def test_places_outside_of_the_folder_are_refused(folder, name):
    with pytest.raises(MrpSumoError):
        folder.save_drawing(name, {}, "")
    with pytest.raises(MrpSumoError):
        folder.open(name, {})


def test_drawings_and_texts_are_saved_under_names_that_say_so(folder):
    with pytest.raises(MrpSumoError, match=r"ends in \.building\.yaml"):
        folder.save_drawing("x.sh", {}, "")
    with pytest.raises(MrpSumoError, match=r"ends in \.yaml or \.csv"):
        folder.save_text("x.sh", "", "")


def test_a_picture_opens_without_a_scale_and_gets_lanes_where_there_is_room(folder):
    hall(folder.root / "hall.png")
    opened = folder.open("hall.png", {})
    level = opened["document"]["levels"]["L1"]
    assert (opened["path"], level["drawing"], level["measurements"]) == ("hall.building.yaml", {"filename": "hall.png"}, [])
    made = lanes_over_floor(folder, "hall.png", {"meters_per_pixel": 0.05}, 2.0, 0.5)
    assert len(made["walls"]) >= 8
    assert all(0 <= v < len(made["vertices"]) for line in (*made["lanes"], *made["walls"]) for v in line[:2])
    for a, b, _ in made["lanes"]:
        (ax, ay, *_), (bx, by, *_) = made["vertices"][a], made["vertices"][b]
        assert abs(ax - bx) + abs(ay - by) == pytest.approx(40)  # 2 m
        assert not (190 < (ax + bx) / 2 < 270 and 140 < (ay + by) / 2 < 260)  # through the rack


def test_what_is_found_says_where(folder):
    document = folder.open("office.building.yaml", {})["document"]
    level = document["levels"]["L1"]
    level["vertices"][0][3] = level["vertices"][1][3] = "twice"
    level["vertices"] += [[100, 100, 0, ""], [300, 100, 0, ""], [200, 50, 0, ""], [200, 150, 0, ""]]
    n = len(level["vertices"]) - 4
    lane = level["lanes"][0][2]
    level["lanes"] += [[n, n + 1, lane], [n + 2, n + 3, lane]]
    result = {finding["kind"]: finding for finding in check(document, Path("office.building.yaml"), ROBOT)["findings"] if "kind" in finding}
    crossing = result["lanes_cross_without_vertex"]["places"]
    assert ["L1", pytest.approx(200), pytest.approx(100)] in [[name, x, y] for name, x, y in crossing]
    twice = {(x, y) for _, x, y in result["name_twice_in_graph"]["places"]}
    assert {tuple(level["vertices"][v][:2]) for v in (0, 1)} <= twice


def test_a_lane_without_room_is_ringed_where_that_is():
    vertices = [
        [0, 0, 0, ""],
        [400, 0, 0, ""],
        [300, -20, 0, ""],
        [300, 20, 0, ""],
        [0, 100, 0, ""],
        [400, 110, 0, ""],
        [80, 103, 0, ""],
        [90, 103, 0, ""],
    ]
    lane = {"bidirectional": [4, True], "graph_idx": [2, 0], "width": [3, 0.1]}
    level = {"vertices": vertices, "measurements": [[0, 1, {"distance": [3, 20.0]}]], "walls": [[2, 3, {}], [6, 7, {}]]}
    document = {"name": "hall", "levels": {"L1": {**level, "lanes": [[0, 1, lane], [4, 5, {**lane, "width": [3, 0.0]}]]}}}
    result = {line["text"]: line["places"] for line in check(document, Path("hall.building.yaml"), ROBOT)["findings"]}
    assert result.pop("lanes lead through a wall: 1") == [["L1", pytest.approx(300), pytest.approx(0, abs=0.1)]]
    assert result.pop(f"lanes too near a wall for '{ROBOT.name}': 1") == [["L1", pytest.approx(90, abs=1), pytest.approx(102, abs=1)]]
    assert not [text for text in result if "goes through wall" in text]
    document["levels"]["L1"]["lanes"] = [[4, 5, lane]]
    result = {line["text"]: line["places"] for line in check(document, Path("hall.building.yaml"), ROBOT)["findings"]}
    assert result[f"lanes narrower than '{ROBOT.name}': 1"] == [["L1", 200.0, 105.0]]


def test_a_drawing_without_lanes_or_scale_is_refused_in_words(folder):
    hall(folder.root / "hall.png")
    document = folder.open("hall.png", {})["document"]
    result = check(document, Path("hall.building.yaml"), ROBOT)
    assert result["refused"] and result["findings"][0]["kind"] == "no_lanes"
    assert check({"levels": 3}, Path("x.building.yaml"), ROBOT)["refused"]


def test_forms_change_one_value_of_a_scenario_and_keep_the_rest():
    path = Path("day.yaml")
    text = "map: office  # ours\nrobots: 4\ntasks:\n  streams:\n    - name: a\n      arrivals: {rate_per_h: 30}  # guessed\n"
    assert with_value(path, text, "tasks.streams.0.arrivals.rate_per_h", 40) == text.replace("rate_per_h: 30", "rate_per_h: 40")
    longer = with_value(path, text, "robots.type", "amr_600")
    assert "count: 4" in longer and "type: amr_600" in longer and longer.startswith("map: office  # ours\n")
    assert with_value(path, with_value(path, text, "seed", 3), "seed", None) == text
    two = with_value(path, text, "tasks.streams.1", {"name": "b", "arrivals": {"rate_per_h": 5}})
    assert two.startswith(text) and [stream["name"] for stream in values_of(path, two)["tasks"]["streams"]] == ["a", "b"]
    assert values_of(path, with_value(path, two, "tasks.streams.1", None)) == values_of(path, text)
    with pytest.raises(MrpSumoError, match="no item 3"):
        with_value(path, text, "tasks.streams.3", {})


def test_faults_of_a_scenario_are_those_of_a_command(tmp_path):
    text = "map: office\nrobots: {cuont: 4}\n"
    assert fault_of(tmp_path / "day.yaml", text).startswith("day.yaml:2: robots.cuont")
    assert fault_of(tmp_path / "day.yaml", text.replace("cuont", "count")) == ""
    assert not list(tmp_path.iterdir())


def test_fields_come_from_the_one_declaration():
    by_key = {field["key"]: field for field in fields()}
    assert (by_key["robots.count"]["least"], by_key["robots.count"]["type"]) == (1, "integer")
    assert (by_key["discretisation.cell_m"]["unit"], by_key["discretisation.cell_m"]["default"]) == ("m", 0.4)
    assert by_key["tasks.streams.0.arrivals.rate_per_h"]["unit"] == "an hour"


def test_pages_and_drawings_open_with_what_they_do_not_say(folder):
    hall(folder.root / "hall.png")
    with Image.open(folder.root / "hall.png") as image:
        image.save(folder.root / "sheet.pdf", resolution=150)
        image.save(folder.root / "sheets.pdf", resolution=150, save_all=True, append_images=[image.rotate(180)])
    assert [folder.layers(name)["pages"] for name in ("sheet.pdf", "sheets.pdf")] == [1, 2]
    assert folder.open("sheets.pdf", {"page": 2})["document"]["levels"]["L1"]["drawing"] == {"filename": "sheets_page2.png"}
    opened = folder.open("sheet.pdf", {})
    assert opened["document"]["levels"]["L1"]["drawing"] == {"filename": "sheet_page1.png"}
    assert folder.picture("sheet_page1.png")[0] == "image/png"
    (folder.root / "walls.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg"><rect width="120" height="80"/></svg>')
    with pytest.raises(MrpSumoError, match="has no scale: state it with --scale"):
        folder.open("walls.svg", {})
    level = folder.open("walls.svg", {"meters_per_pixel": 0.1})["document"]["levels"]["L1"]
    assert (len(level["walls"]), level["lanes"]) == (4, [])
    assert {entry["kind"] for entry in folder.files() if entry["path"].startswith(("sheet", "walls"))} == {"plan"}


def test_a_file_from_elsewhere_is_a_new_file_of_the_folder(folder):
    folder.add("hall.png", b"1")
    assert (folder.root / "hall.png").read_bytes() == b"1"
    with pytest.raises(Stale, match="is there already: nothing was written"):
        folder.add("hall.png", b"2")
    for name in ("../hall.png", "a\\\\b.png", ".png", "run.sh", ""):
        with pytest.raises(MrpSumoError, match="expected a plan or a map"):
            folder.add(name, b"")
    assert (folder.root / "hall.png").read_bytes() == b"1"


def test_files_are_listed_by_what_they_are_for(folder):
    for name in ("runs/a/result.json", "studies/b/answer.json", "variants/c/plan.json", "variants/c/results.csv", ".git/x.png"):
        (folder.root / name).parent.mkdir(parents=True, exist_ok=True)
        (folder.root / name).write_text("{}")
    (folder.root / "day.yaml").write_text("map: office\nrobots: {count: 2}\n")
    (folder.root / "all.yaml").write_text("base: day\ngrid_search: {seed: [1]}\n")
    kinds = {entry["path"]: entry["kind"] for entry in folder.files()}
    folders = {"runs/a": "run", "studies/b": "study", "variants/c": "comparison"}
    assert kinds == {"office.building.yaml": "map", "day.yaml": "scenario", "all.yaml": "suite", **folders}


def test_a_lift_that_no_lane_leads_into_is_found_where_it_is(tmp_path):
    document = Workspace(tmp_path.resolve()).open("bundled:hospital_levels", {})["document"]
    document["lifts"]["lift_west"]["x"] += 30
    result = check(document, Path("hospital_levels.building.yaml"), ROBOT)["findings"]
    places = [place for line in result if "'lift_west' stops at level L2" in line["text"] for place in line["places"]]
    assert places == [["L2", pytest.approx(338, abs=0.1), pytest.approx(112, abs=0.1)]]


def test_a_variant_has_the_text_of_its_layout_where_it_says_the_same(folder):
    opened = folder.open("office.building.yaml", {})
    opened["document"]["levels"]["L1"]["vertices"][0][3] = "elsewhere"
    folder.save_drawing("office_moved.building.yaml", opened["document"], "", "office.building.yaml")
    before, after = ((folder.root / name).read_text().splitlines() for name in ("office.building.yaml", "office_moved.building.yaml"))
    assert len(before) == len(after)
    assert [line for line, other in zip(after, before) if line != other] == [line for line in after if "elsewhere" in line]
    with pytest.raises(Stale):
        folder.save_drawing("office_moved.building.yaml", opened["document"], "", "office.building.yaml")


def test_layers_of_a_drawing_are_listed_with_their_lines(folder):
    draw(folder.root / "hall.dxf")
    result = folder.layers("hall.dxf")
    assert (result["unit"], result["units"]["ft"], result["size"]) == ("", 0.3048, [30.0, 20.0])
    layers = {layer["name"]: layer for layer in result["layers"]}
    assert {name: (layer["strokes"], layer["shown"]) for name, layer in layers.items()} == {"WALLS": (4, True), "TABLES": (1, False)}
    assert layers["TABLES"]["lines"] == [[167, 500, 333, 500]]  # thousandths of 30 m, from the upper left; y of 667 is the lower wall
    chosen = {"layers": ("WALLS", "TABLES"), "unit": "m"}
    assert len(folder.open("hall.dxf", chosen)["document"]["levels"]["L1"]["walls"]) == 5
    level = folder.open("hall.dxf", {"layers": ("WALLS",), "unit": "m"})["document"]["levels"]["L1"]
    made = lanes_over_floor(folder, "hall.dxf", {"layers": ("WALLS",), "unit": "m"}, 2.0, 0.5)
    corners = [level["vertices"][v][:2] for wall in level["walls"] for v in wall[:2]]
    assert len(made["lanes"]) > 100 and not made["walls"]
    for k in (0, 1):  # 0.5 m, 10 pixels, within the walls
        low, high = min(corner[k] for corner in corners), max(corner[k] for corner in corners)
        assert all(low + 10 <= vertex[k] <= high - 10 for vertex in made["vertices"])
    (folder.root / "hall.svg").write_text(
        '<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd">\n'
        '<svg xmlns="http://www.w3.org/2000/svg"><g id="A"><rect width="9" height="6"/></g><g id="B"><path d="M1 1H2"/></g></svg>'
    )
    assert [(layer["name"], layer["strokes"]) for layer in folder.layers("hall.svg")["layers"]] == [("A", 4), ("B", 1)]
