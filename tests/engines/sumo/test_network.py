"""The SUMO network has the graph's lanes, exactly, and nothing of the machine that made it."""

import errno
import re
import subprocess
import tempfile

import libsumo
import pytest

from mrp_sumo.core.graph import nav_graph
from mrp_sumo.engines.sumo.network import NO_LIMIT_MPS, build_network, edge_name, lane_ends
from mrp_sumo.errors import MapError

# a two-way corridor of 0-1-2 with a one-way lane 2 -> 3, and vertex 4 without lanes
GRAPH = nav_graph(
    name="tee",
    xy=[(0, 0), (0.4, 0), (0.8, 0), (0.8, -1.5), (9, 9)],
    lanes=[(0, 1), (1, 0), (1, 2), (2, 1), (2, 3)],
    speed_mps=[float("inf")] * 4 + [0.5],
)


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    return build_network(GRAPH, tmp_path_factory.mktemp("net") / "tee.net.xml")


def test_edge_names_are_reversible():
    assert edge_name(7, 9) == "e7_9"
    assert lane_ends("e7_9") == (7, 9)


def test_sumo_sees_every_lane_with_its_length_limit_and_straight_shape(network):
    libsumo.start(["sumo", "-n", str(network), "--no-step-log", "true"])
    try:
        edges = {e for e in libsumo.edge.getIDList() if not e.startswith(":")}
        assert edges == {"e0_1", "e1_0", "e1_2", "e2_1", "e2_3"}
        assert libsumo.lane.getLength("e2_3_0") == pytest.approx(1.5)
        assert libsumo.lane.getMaxSpeed("e2_3_0") == pytest.approx(0.5)
        assert libsumo.lane.getMaxSpeed("e0_1_0") == pytest.approx(NO_LIMIT_MPS)  # faster fleets raise it when they are inserted
        assert libsumo.lane.getShape("e1_2_0") == ((0.4, 0.0), (0.8, 0.0))
        onward = {link[0] for link in libsumo.lane.getLinks("e1_2_0")}
        assert onward == {"e2_1_0", "e2_3_0"}  # turning back is possible
    finally:
        libsumo.close()


def test_two_way_lanes_are_tied_and_one_way_lanes_are_not(network):
    bidi = dict(re.findall(r'<edge id="(\w+)"[^>]* bidi="(\w+)"', network.read_text()))
    assert bidi == {"e0_1": "e1_0", "e1_0": "e0_1", "e1_2": "e2_1", "e2_1": "e1_2"}


def test_the_same_graph_gives_the_same_bytes_without_date_or_path(network, tmp_path):
    again = build_network(GRAPH, tmp_path / "other.net.xml")
    assert again.read_bytes() == network.read_bytes()
    assert "<!--" not in network.read_text()
    assert str(tmp_path) not in again.read_text()


def test_a_graph_without_lanes_is_refused(tmp_path):
    with pytest.raises(MapError, match="'dots' has no lanes"):
        build_network(nav_graph(name="dots", xy=[(0, 0)], lanes=[]), tmp_path / "x.net.xml")
    assert not list(tmp_path.iterdir())


def test_junctions_are_drawn_smaller_than_the_lanes_between_them(network):
    shapes = re.findall(r'<junction [^>]* shape="([^"]+)"', network.read_text())
    assert len(shapes) == 4
    for shape in shapes:
        x = [float(corner.split(",")[0]) for corner in shape.split()]
        assert max(x) - min(x) < 0.2


def test_vertices_a_centimetre_apart_are_joined_by_the_shortest_edge_sumo_has(tmp_path):
    near = nav_graph(name="near", xy=[(0, 0), (0.01, 0), (1, 0)], lanes=[(0, 1), (1, 0), (1, 2), (2, 1)])
    text = build_network(near, tmp_path / "near.net.xml").read_text()
    assert re.findall(r'<lane id="e0_1_0"[^>]* length="([^"]+)"', text) == ["0.100000"]
    assert len(re.findall("<edge ", text)) == 4


def test_half_a_network_of_a_full_disk_is_neither_used_nor_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    run = subprocess.run

    def fills_the_disk(command, cwd, **options):
        done = run(command, cwd=cwd, **options)
        file = cwd / "x.net.xml"
        file.write_text(file.read_text()[:-20])
        return done

    monkeypatch.setattr(subprocess, "run", fills_the_disk)
    with pytest.raises(OSError, match="28") as refused:
        build_network(GRAPH, tmp_path / "tee.net.xml")
    assert (refused.value.errno, refused.value.filename) == (errno.ENOSPC, tempfile.gettempdir())
    assert not list(tmp_path.rglob("*.net.xml"))
    monkeypatch.undo()
    assert build_network(GRAPH, tmp_path / "tee.net.xml").read_text().endswith("</net>\n")
