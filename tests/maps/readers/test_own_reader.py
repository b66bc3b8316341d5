"""A map reader of a user: one class in a file, by the scenario or the command line; what it does wrong is one line."""

import json

import pytest

from mrp_sumo.cli.main import main
from mrp_sumo.errors import MapError, PlugInError
from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.readers.registry import OURS

MINE = '''"""Maps as CSV: name,x,y of stations along a street."""

from mrp_sumo.core.graph import nav_graph
from mrp_sumo.maps.map import Map


class Street:
    name = "street CSV"
    suffixes = (".csv",)

    def detects(self, file):
        return file.text.startswith("station,")

    def read(self, file, selection):
        rows = [line.split(",") for line in file.text.splitlines()[1:]]
        pairs = [(i, i + 1) for i in range(len(rows) - 1)]
        nav = nav_graph(
            name=file.path.stem,
            xy=[(float(x), float(y)) for _, x, y in rows],
            lanes=pairs + [(b, a) for a, b in pairs],
            vertex_name=tuple(name for name, _, _ in rows),
        )
        return Map(name=nav.name, path=file.path, nav=nav)


class Broken(Street):
    def read(self, file, selection):
        return 1 / 0


class Wrong(Street):
    def read(self, file, selection):
        return {}


class Blind:
    name = "blind"
    suffixes = ()
'''


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a map and a file of readers."""
    (tmp_path / "mine.py").write_text(MINE)
    (tmp_path / "street.csv").write_text("station,x,y\na,0,0\nb,4,0\nc,8,0\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_reader_of_a_file_reads_its_format(folder):
    result = load_map(folder / "street.csv", reader="mine.py:Street")
    assert (result.nav.num_vertices, result.nav.vertex_name) == (3, ("a", "b", "c"))


def test_scenario_names_its_reader_and_the_run_drives_on_the_map(folder):
    (folder / "inner").mkdir()
    scenario = folder / "inner" / "street.yaml"
    scenario.write_text(
        "map: {file: ../street.csv, reader: ../mine.py:Street}\ndiscretisation: {kind: roadmap, cell_m: 0.5}\n"
        "robots: {starts: [a], goals: [c]}\nplanner: pibt\n"
    )
    assert main(["run", str(scenario), "--out", "run"]) == 0
    assert json.loads((folder / "run" / "result.json").read_text())["robots"][0]["goal"] == "c"


def test_import_takes_a_reader(folder, capsys):
    assert main(["import", "street.csv", "--reader", "mine.py:Street", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["vertices"] == 3


@pytest.mark.parametrize(
    ("name", "output"),
    [
        ("mine.py:Broken", r"mine.py:\d+: in read: ZeroDivisionError: division by zero"),
        ("mine.py:Wrong", r"mine.py:\d+: read gives dict, expected a Map"),
        ("mine.py:Blind", r"mine.py:\d+: Blind is no map reader: it has no method detects\(file\)"),
    ],
)
def test_reader_that_breaks_its_contract_is_one_line_with_its_file(folder, name, output):
    with pytest.raises(PlugInError, match=output):
        load_map(folder / "street.csv", reader=name)


def test_file_that_no_reader_recognises_is_told_which_formats_there_are(folder):
    with pytest.raises(MapError, match=r"not a map this program reads: .*MovingAI grid \(\.map\).*RMF building \(\.building\.yaml\)"):
        load_map(folder / "street.csv")


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("type octile\nheight 1\nwidth 2\nmap\n..\n", "movingai_map"),
        ("version 1\n0\tm.map\t2\t1\t0\t0\t1\t0\t1\n", "movingai_scen"),
        ("name: b\nlevels: {L1: {elevation: 0, walls: []}}\n", "rmf_building"),
        ("building_name: b\nlevels: {L1: {lanes: [[0, 1, {}]], vertices: [[0, 0, {}], [1, 0, {}]]}}\n", "rmf_nav_graph"),
        ("levels: {L1: {lanes: [[0, 1, {}]], vertices: [[0, 0, {}], [1, 0, {}]]}}\n", "rmf_nav_graph"),
        ("levels: {L1: {lanes: [[0, 1, {}]], vertices: [[0, 0, 0, a], [1, 0, 0, b]]}}\n", "rmf_building"),
        ("image: m.pgm\nresolution: 0.05\n", "ros_map"),
    ],
)
def test_one_bundled_reader_recognises_each_format(tmp_path, text, name):
    from mrp_sumo.maps.readers.reader import map_file
    from mrp_sumo.plugins.registry import make

    (tmp_path / "m").write_text(text)
    file = map_file(tmp_path / "m")
    assert [other for other in OURS if make("readers", other, {}).detects(file)] == [name]
