"""Plans of a floor: drawings in DXF and pictures with a scale. All are of one hall, 12 x 8 m, with a rack of 4 x 1 m in it."""

from pathlib import Path

import ezdxf
import numpy as np
import pytest
from PIL import Image, ImageDraw

from mrp_sumo.cli.main import main
from mrp_sumo.errors import MapError
from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.readers.plan import _traced
from mrp_sumo.maps.readers.svg import read_svg
from mrp_sumo.maps.yaml_text import Text

INCH, FOOT, MM, M, NONE = 1, 2, 4, 6, 0  # $INSUNITS


def hall(path, unit=M, scale=1.0, form="asc", surroundings=False):
    """A drawing of the hall, with the rack as a block, a word, and a door's arc of 1 m."""
    drawing = ezdxf.new()
    drawing.header["$INSUNITS"] = unit
    space = drawing.modelspace()
    for name in ("WALLS", "RACKS", "DOORS", "WORDS", "SPARE", "SITE"):
        drawing.layers.add(name)
    space.add_lwpolyline([(0, 0), (12 * scale, 0), (12 * scale, 8 * scale), (0, 8 * scale)], close=True, dxfattribs={"layer": "WALLS"})
    rack = drawing.blocks.new("RACK")
    rack.add_lwpolyline([(0, 0), (4, 0), (4, 1), (0, 1)], close=True)  # on layer 0: of the layer where it is inserted
    space.add_blockref("RACK", (4 * scale, 4 * scale), dxfattribs={"layer": "RACKS", "xscale": scale, "yscale": scale})
    space.add_arc((0, 2 * scale), 1 * scale, 0, 90, dxfattribs={"layer": "DOORS"})
    space.add_text("Hall", dxfattribs={"layer": "WORDS"})
    if surroundings:
        space.add_circle((6 * scale, 4 * scale), 7.4 * scale, dxfattribs={"layer": "SITE"})
    drawing.saveas(path, fmt=form)
    return path


@pytest.mark.parametrize(
    ("unit", "scale", "form"),
    [(M, 1.0, "asc"), (MM, 1000.0, "asc"), (INCH, 1 / 0.0254, "asc"), (FOOT, 1 / 0.3048, "asc"), (M, 1.0, "bin")],
)
def test_a_drawing_has_its_walls_in_metres_and_a_grid_between_them(tmp_path, unit, scale, form):
    result = load_map(hall(tmp_path / "hall.dxf", unit, scale, form), layers=("WALLS", "racks"), cell_m=0.5, robot_radius_m=0.2)
    walls = result.building.levels["L1"].wall_xy
    assert np.ptp(walls.reshape(-1, 2), axis=0).tolist() == pytest.approx([12, 8])
    assert sorted(np.hypot(*(walls[:, 1] - walls[:, 0]).T).round(6)) == [1, 1, 4, 4, 8, 8, 12, 12]
    assert len(walls) == 8
    # 24 x 16 cells; each has 0.25 m to a wall beside it, and the 8 x 2 in the rack are left out
    assert result.nav.num_vertices == 24 * 16 - 8 * 2
    assert "pieces_left_out" in {finding.kind for finding in result.findings}


def test_a_robot_that_is_too_large_for_the_cells_beside_walls_leaves_them_out(tmp_path):
    path = hall(tmp_path / "hall.dxf")
    assert load_map(path, layers=("WALLS",), cell_m=0.5, robot_radius_m=0.2).nav.num_vertices == 24 * 16
    assert load_map(path, layers=("WALLS",), cell_m=0.5, robot_radius_m=0.3).nav.num_vertices == 22 * 14


def test_all_layers_that_are_shown_are_walls_by_default(tmp_path):
    path = hall(tmp_path / "hall.dxf")
    result = load_map(path)
    assert next(f.details[0] for f in result.findings if f.kind == "walls_of_layers").startswith("WALLS (4), RACKS (4), DOORS (")
    drawing = ezdxf.readfile(path)
    drawing.layers.get("DOORS").off()
    drawing.layers.get("RACKS").freeze()
    drawing.saveas(path)
    assert len(load_map(path).building.levels["L1"].wall_xy) == 4
    assert len(load_map(path, layers=("RACKS", "WALLS")).building.levels["L1"].wall_xy) == 8  # named, they count


def test_arcs_are_flattened_within_a_centimetre(tmp_path):
    ends = load_map(hall(tmp_path / "hall.dxf"), layers=("WALLS", "DOORS")).building.levels["L1"].wall_xy[4:]
    middles = ends.mean(axis=1) - (0, 2)
    assert np.hypot(*(ends.reshape(-1, 2) - (0, 2)).T) == pytest.approx(1.0, abs=1e-3)
    assert (np.hypot(*middles.T) > 0.99).all()


def test_what_the_walls_do_not_enclose_is_left_out(tmp_path):
    surroundings = load_map(hall(tmp_path / "a.dxf", surroundings=True), layers=("SITE", "WALLS"), cell_m=0.5, robot_radius_m=0.2)
    alone = load_map(hall(tmp_path / "b.dxf"), layers=("WALLS",), cell_m=0.5, robot_radius_m=0.2)
    kinds = {finding.kind for finding in surroundings.findings}
    assert {"outside_left_out", "pieces_left_out"} <= kinds  # the corners round the circle; the ring between it and the hall
    assert (surroundings.nav.xy > 0.2).all()
    assert (surroundings.nav.xy < np.array([12, 8]) - 0.2).all()
    assert "outside_left_out" not in {finding.kind for finding in alone.findings}


@pytest.mark.parametrize(
    ("made", "choice", "message"),
    [
        (
            {"unit": NONE},
            {},
            "hall.dxf: says no unit ($INSUNITS is 0): state it with mrp-sumo import --unit, one of mm, cm, dm, m, in, ft; "
            "in m the drawing is 12 x 8 m",
        ),
        ({}, {"layers": ("WALS",)}, "hall.dxf: no layer 'WALS' (did you mean 'WALLS'?); strokes are on DOORS, RACKS, WALLS"),
        ({}, {"layers": ("WORDS",)}, "hall.dxf: layer 'WORDS' holds no line, polyline, arc or block (1 TEXT)"),
        ({}, {"layers": ("SPARE",)}, "hall.dxf: layer 'SPARE' holds no line, polyline, arc or block (it is empty)"),
        ({}, {"unit": "mile"}, "unit 'mile' is none of mm, cm, dm, m, in, ft"),
        (
            {"scale": 1000.0},
            {},
            "hall.dxf: the drawing is 1.2e+04 x 8000 m in m: state another with mrp-sumo import --unit, "
            "or choose --layers (WALLS, RACKS, DOORS)",
        ),
        ({}, {"unit": "mm"}, "hall.dxf: the drawing is 0.012 x 0.008 m in mm: state another with mrp-sumo import --unit"),
        ({}, {"meters_per_pixel": 0.1}, "hall.dxf: this kind of map has no scale in metres per pixel to choose"),
    ],
)
def test_drawings_that_cannot_be_read_say_what_could_be_done(tmp_path, made, choice, message):
    path = hall(tmp_path / "hall.dxf", **made)
    with pytest.raises(MapError) as error:
        load_map(path, **choice)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_unit_that_is_stated_counts_more_than_the_headers(tmp_path):
    stated = load_map(hall(tmp_path / "hall.dxf", NONE, 1000.0), unit="mm")
    assert stated.nav.num_vertices == load_map(hall(tmp_path / "m.dxf")).nav.num_vertices


@pytest.mark.parametrize("form", ["asc", "bin"])
@pytest.mark.parametrize("share", [0.3, 0.9, 0.999])
def test_a_drawing_that_breaks_off_is_refused(tmp_path, form, share):
    data = hall(tmp_path / "whole.dxf", form=form).read_bytes()
    path = tmp_path / "cut.dxf"
    path.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(MapError, match="not a complete DXF"):
        load_map(path)


def picture(path, mode="RGB", **save):
    """The hall at 5 cm a pixel, walls of one pixel inside its edge."""
    image = Image.new(mode, (240, 160), (255, 255, 255, 0) if mode == "RGBA" else "white")
    draw = ImageDraw.Draw(image)
    draw.rectangle((0, 0, 239, 159), outline="black")
    draw.rectangle((80, 60, 159, 79), outline="navy", fill="lightgray")
    image.save(path, **save)
    return path


@pytest.mark.parametrize(("name", "mode"), [("hall.png", "RGB"), ("hall.png", "RGBA"), ("hall.bmp", "RGB"), ("hall.tif", "L")])
def test_a_picture_with_a_scale_has_walls_and_a_grid(tmp_path, name, mode):
    result = load_map(picture(tmp_path / name, mode), meters_per_pixel=0.05, cell_m=0.5, robot_radius_m=0.15)
    assert result.nav.num_vertices == 24 * 16 - 8 * 2
    walls = result.building.levels["L1"].wall_xy
    assert sorted(np.hypot(*(walls[:, 1] - walls[:, 0]).T).round(6)) == pytest.approx(
        [0.9, 0.9, 1, 1, 3.9, 3.9, 4, 4, 7.9, 7.9, 11.9, 11.9]
    )
    rack = walls[(np.abs(walls - (6, 4.5)) < (2.01, 0.51)).all((1, 2))]  # the picture's first row is the highest y
    assert len(rack) == 8


def test_a_large_piece_that_is_left_out_is_written_in_plain_numbers(tmp_path):
    image = Image.new("L", (240, 160), "white")
    ImageDraw.Draw(image).rectangle((0, 0, 239, 159), outline="black")
    ImageDraw.Draw(image).rectangle((60, 40, 119, 119), outline="black")  # 30 x 40 m that nobody gets into
    image.save(tmp_path / "hall.png")
    result = load_map(tmp_path / "hall.png", meters_per_pixel=0.5, cell_m=1.0, robot_radius_m=0.2)
    (line,) = (f.details[0] for f in result.findings if f.kind == "pieces_left_out")
    assert line.startswith("1 piece, 1064 m2 of 8998, which")


@pytest.mark.parametrize("cell_m", [float("nan"), float("inf"), 0.0])
def test_cells_of_no_length_are_refused(tmp_path, cell_m):
    with pytest.raises(MapError, match=r"the cell length is \S+ m, expected at least 0.01 m"):
        load_map(picture(tmp_path / "hall.png"), meters_per_pixel=0.05, cell_m=cell_m, robot_radius_m=0.15)


def test_pictures_that_cannot_be_read_say_what_could_be_done(tmp_path):
    path = picture(tmp_path / "hall.png")
    with pytest.raises(MapError, match=r"hall.png: a picture has no scale: state it with --scale, 0.05"):
        load_map(path)
    with pytest.raises(MapError, match=r"hall.png: this kind of map has no layers to choose"):
        load_map(path, meters_per_pixel=0.05, layers=("A",))
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(MapError, match=r"image 'hall.png' cannot be read"):
        load_map(path, meters_per_pixel=0.05)
    Image.new("1", (7100, 7100)).save(path)
    with pytest.raises(MapError, match=r"7100 x 7100 pixels, too many: at most 50 million are read"):
        load_map(path, meters_per_pixel=0.05)
    Image.new("L", (100, 100)).save(path)
    with pytest.raises(MapError, match="no place where a robot of radius"):
        load_map(path, meters_per_pixel=0.05)


@pytest.mark.parametrize(
    ("name", "data", "cure"),
    [
        ("a.dwg", b"AC1027" + bytes(20), "an AutoCAD drawing (DWG), which CAD programs alone read: save it as DXF"),
        ("a.zip", b"PK\x03\x04" + bytes(9), "an archive: unpack it"),
        ("a.opentcs", b'<?xml version="1.0"?>\n<model xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"/>', "openTCS 4.8 to 4.20"),
        ("a.xml", b"<transportOrders/>", "import the plant model"),
        ("a.osm", b"<osm/>", "netconvert --osm-files"),
        ("a.bin", b"\0\1\2\3", "a.bin: binary data, not a map file"),
    ],
)
def test_files_that_are_no_maps_are_named_with_what_could_be_done(tmp_path, name, data, cure):
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(MapError) as error:
        load_map(path)
    assert cure in str(error.value)


def test_an_imported_plan_is_a_map_that_runs(tmp_path, capsys):
    assert (
        main(["import", str(hall(tmp_path / "hall.dxf")), "--layers", "WALLS,RACKS", "--unit", "m", "--out", str(tmp_path / "site")]) == 0
    )
    again = load_map(tmp_path / "site" / "hall_map.yaml")
    drawn = load_map(tmp_path / "hall.dxf", layers=("WALLS", "RACKS"))
    assert again.nav.num_vertices == drawn.nav.num_vertices
    scenario = tmp_path / "day.yaml"
    scenario.write_text("map: site/hall_map.yaml\nrobots: {count: 3, type: turtlebot3}\nplanner: lacam\n")
    capsys.readouterr()
    assert main(["run", str(scenario), "--out", str(tmp_path / "run"), "--json"]) == 0
    assert '"status": "completed"' in capsys.readouterr().out


def test_an_imported_plan_has_its_walls_to_draw_lanes_on(tmp_path, capsys):
    made = tmp_path / "site" / "hall.building.yaml"
    assert main(["import", str(hall(tmp_path / "hall.dxf")), "--layers", "WALLS,RACKS", "--out", str(tmp_path / "site")]) == 0
    capsys.readouterr()
    assert main(["import", str(made), "--check"]) == 2
    assert capsys.readouterr().out.startswith("hall.building.yaml: refuse: no lanes: 10 vertices, 8 walls")
    made.write_text(made.read_text().replace("lanes: []", "lanes:\n      - [0, 1, {graph_idx: [2, 0], bidirectional: [4, true]}]"))
    walls = load_map(made).building.levels["L1"].wall_xy
    assert np.ptp(walls.reshape(-1, 2), axis=0).tolist() == pytest.approx([12, 8])


@pytest.mark.parametrize(("scale", "metres_a_pixel"), [("0.1", 0.1), ("0,0:120,0=12", 0.1), ("10,10:40,50=5", 0.1), ("0,0:0,80=4", 0.05)])
def test_a_pictures_scale_is_metres_a_pixel_or_a_distance_between_two_places(tmp_path, scale, metres_a_pixel, capsys):
    assert main(["import", str(picture(tmp_path / "hall.png")), "--scale", scale, "--out", str(tmp_path / "site")]) == 0
    made = tmp_path / "site" / "hall.building.yaml"
    with Image.open(tmp_path / "site" / "hall_plan.png") as drawing:
        assert drawing.width * metres_a_pixel == pytest.approx(float(made.read_text().split("x_meters: ")[1].split("\n")[0]))
    assert 'filename: "hall_plan.png"' in made.read_text()


@pytest.mark.parametrize(
    ("scale", "why"), [("1,2=3", "expected X,Y:X,Y=M"), ("1,2:1,2=3", "two places that are apart"), ("0,0:1,0=x", "number")]
)
def test_a_scale_that_is_none_is_one_line(tmp_path, scale, why, capsys):
    assert main(["import", str(tmp_path / "hall.png"), "--scale", scale, "--check"]) == 2
    said = capsys.readouterr().err
    assert why in said and said.count("\n") == 1


SVG = """<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="i" viewBox="0 0 120 80">
  <defs><path d="M0 0H500V500"/></defs>
  <g id="g1" inkscape:label="WALLS" transform="translate(0 80) scale(1 -1)"><rect x="0" y="0" width="120" height="80"/></g>
  <g id="RACKS"><path d="m40,30 h40 v10 h-40 z"/></g>
  <g id="WORDS" style="display: none"><line x1="0" y1="0" x2="50" y2="50"/><text>Hall</text></g>
</svg>
"""


def test_an_svg_with_a_scale_has_the_walls_of_its_layers(tmp_path):
    path = tmp_path / "hall.svg"
    path.write_text(SVG)
    result = load_map(path, meters_per_pixel=0.1, cell_m=0.5, robot_radius_m=0.2)
    walls = result.building.levels["L1"].wall_xy
    assert sorted(np.hypot(*(walls[:, 1] - walls[:, 0]).T).round(6)) == [1, 1, 4, 4, 8, 8, 12, 12]
    assert result.nav.num_vertices == 24 * 16 - 8 * 2
    assert len(load_map(path, meters_per_pixel=0.1, layers=("walls",)).building.levels["L1"].wall_xy) == 4


@pytest.mark.parametrize(
    ("d", "length", "most"),
    [
        ("M0 0 A 50 50 0 0 1 100 0", np.pi * 50, 50.0),  # half a circle
        ("M0,0 C 0,0 100,0 100,0", 100.0, 0.0),  # a straight line as a curve
        ("M0 0 Q 50 100 100 0", 147.9, 50.0),  # a parabola
        ("M0 0 10 0 10 10 0 10Z", 40.0, 10.0),
    ],
)
def test_paths_of_an_svg_are_flattened(d, length, most):
    strokes = read_svg(Text(Path("a.svg"), f'<svg><path d="{d}"/></svg>')).strokes
    assert np.hypot(*(strokes[:, 1] - strokes[:, 0]).T).sum() == pytest.approx(length, rel=3e-3)
    assert np.abs(strokes[..., 1]).max() == pytest.approx(most, rel=1e-2)


@pytest.mark.parametrize(
    ("text", "choice", "why"),
    [
        (SVG, {}, "hall.svg: an SVG drawing has no scale: state it with --scale, metres a unit"),
        (
            SVG,
            {"meters_per_pixel": 0.1, "layers": ("WALS",)},
            "hall.svg: no layer 'WALS' (did you mean 'WALLS'?); strokes are on RACKS, WALLS",
        ),
        (SVG, {"meters_per_pixel": 0.001}, "hall.svg: the drawing is 0.12 x 0.08 m at 0.001 m a unit: state another --scale"),
        ("<svg><text>Hall</text></svg>", {"meters_per_pixel": 0.1}, "hall.svg: nothing is drawn"),
        ('<svg><path d="M 0 0 L 1"/></svg>', {"meters_per_pixel": 0.1}, "a path breaks off in 'L'"),
        ('<svg><path d="1 2"/></svg>', {"meters_per_pixel": 0.1}, "a path begins with a number"),
        ('<svg><rect width="x"/></svg>', {"meters_per_pixel": 0.1}, "<rect>: width is 'x', expected a number"),
        ("<svg><g>", {"meters_per_pixel": 0.1}, "not XML"),
    ],
)
def test_an_svg_that_cannot_be_read_is_one_line(tmp_path, text, choice, why):
    path = tmp_path / "hall.svg"
    path.write_text(text)
    with pytest.raises(MapError) as error:
        load_map(path, **choice)
    assert why in str(error.value) and "\n" not in str(error.value)


def test_a_page_of_a_pdf_is_a_picture_of_150_pixels_an_inch(tmp_path, capsys):
    with Image.open(picture(tmp_path / "hall.png")) as image:
        image.convert("RGB").save(
            tmp_path / "hall.pdf", resolution=150, save_all=True, append_images=[Image.new("RGB", (300, 300), "white")]
        )
    result = load_map(tmp_path / "hall.pdf", meters_per_pixel=0.05, cell_m=0.5, robot_radius_m=0.15)
    assert result.nav.num_vertices == 24 * 16 - 8 * 2
    with pytest.raises(MapError, match=r"hall.pdf: no page 3, expected 1 to 2"):
        load_map(tmp_path / "hall.pdf", meters_per_pixel=0.05, page=3)
    with pytest.raises(MapError, match=r"150 pixels an inch, has no scale: state it with --scale.*; the plan is 240 x 16\d pixels"):
        load_map(tmp_path / "hall.pdf")
    assert main(["import", str(tmp_path / "hall.pdf"), "--scale", "0.05", "--page", "1", "--out", str(tmp_path / "site")]) == 0
    assert "walls:" in (tmp_path / "site" / "hall.building.yaml").read_text()


def test_a_pdf_that_is_none_is_one_line(tmp_path):
    path = tmp_path / "a.pdf"
    path.write_bytes(b"%PDF-1.7\n\xe2\xe3" + bytes(9))
    with pytest.raises(MapError, match=r"a.pdf: cannot be read .*: print it as a new PDF, or save the page as PNG"):
        load_map(path, meters_per_pixel=0.05)


def test_a_picture_with_much_hatching_has_coarser_walls(tmp_path):
    """Three thousand dots of 2 pixels, 4 apart: each has four sides, until squares of 2 pixels make it a dot of one, which is a stroke."""
    shade = np.full((400, 800), 255, np.uint8)
    shade[[0, -1]] = shade[:, [0, -1]] = 0
    for k in range(4):
        shade[40 + k // 2 : 280 : 4, 400 + k % 2 : 600 : 4] = 0
    Image.fromarray(shade).save(tmp_path / "hall.png")
    map_ = load_map(tmp_path / "hall.png", meters_per_pixel=0.05)
    assert [f.details for f in map_.findings if f.kind == "walls_traced_coarsely"] == [
        ("outlines of what is dark are drawn up to 0.1 m too far out",)
    ]
    walls = map_.building.levels["L1"].wall_xy
    assert 40 < len(walls) <= 10_000
    assert np.ptp(walls.reshape(-1, 2), axis=0) == pytest.approx([40, 20], abs=0.4)


def test_a_slanted_wall_of_a_picture_is_a_few_strokes_and_a_corner_stays():
    """A wall of 3 pixels that climbs one pixel in ten, and a square of 40: 4 sides each, about."""
    clear = np.ones((80, 200), np.bool_)
    for x in range(100):
        clear[5 + x // 10 : 8 + x // 10, 10 + x] = False
    slanted = _traced(clear)
    assert len(slanted) <= 6
    assert abs(np.hypot(*(slanted[:, 1] - slanted[:, 0]).T).sum() - 2 * (100 + 3)) < 6
    clear[:] = True
    clear[20:60, 120:160] = False
    square = {tuple(sorted(map(tuple, stroke))) for stroke in _traced(clear).tolist()}
    corners = [(120, 20), (120, 60), (160, 60), (160, 20)]
    assert square == {tuple(sorted((corners[k], corners[k - 1]))) for k in range(4)}


def test_a_drawing_on_a_sheet_of_paper_alone_is_told_from_an_empty_one(tmp_path):
    drawing = ezdxf.new()
    for fault in ("nothing is drawn: no line", "nothing is drawn in model space, but on the sheet 'Layout1': copy that to model space"):
        drawing.saveas(tmp_path / "hall.dxf")
        with pytest.raises(MapError, match=fault):
            load_map(tmp_path / "hall.dxf", unit="m")
        drawing.layout("Layout1").add_line((0, 0), (30, 0))
