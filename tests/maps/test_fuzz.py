"""Mutilated maps: every reader returns a map or raises MapError with one line, and nothing else."""

import json
import re

import pytest
from golden import MAPS
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lif_worlds import LIF, lif_2
from map_worlds import CSV, LINK, MODEL, ROUTE, SITE

from mrp_sumo.errors import MapError
from mrp_sumo.maps.facts import facts
from mrp_sumo.maps.load import load_map

pytestmark = pytest.mark.slow

SMALL = """
name: small
levels:
  L1:
    vertices: [[0, 0, 0, a, {is_charger: [4, true]}], [100, 0, 0, b], [100, 80, 0, c, {dock_name: [1, c]}]]
    measurements: [[0, 1, {distance: [3, 10]}]]
    walls: [[0, 1, {}]]
    floors: [{vertices: [0, 1, 2], parameters: {}}]
    doors: [[0, 2, {name: [1, d]}]]
    fiducials: [[0, 0, f], [50, 50, g]]
    lanes:
      - [0, 1, {graph_idx: [2, 0], bidirectional: [4, true], orientation: [1, forward]}]
      - [1, 2, {graph_idx: [2, 1], bidirectional: [4, false], speed_limit: [3, 0.5]}]
  L2:
    elevation: 3
    vertices: [[0, 0, 0, ""], [50, 50, 0, e]]
    fiducials: [[0, 0, f], [50, 50, g]]
    lanes: [[0, 1, {graph_idx: [2, 0], bidirectional: [4, true]}]]
lifts:
  cabin: {x: 0, y: 0, yaw: 0, width: 2, depth: 2, highest_floor: L2, level_doors: {L1: [d], L2: [d]}}
"""
NAV = """
building_name: nav
offset: [5, 5]
levels:
  L1:
    vertices: [[0, 0, {name: a}], [1, 0, {name: b, lift: l}]]
    lanes: [[0, 1, {speed_limit: 0.5}], [1, 0, {}]]
  L2:
    vertices: [[0, 0, {lift: l}], [1, 0]]
    lanes: [[0, 1, {is_bidirectional: false}]]
"""
EARTH = """
name: earth
coordinate_system: wgs84
parameters: {generate_crs: [1, 'EPSG:3414'], suggested_offset_x: [3, 22000], suggested_offset_y: [3, 31500]}
levels:
  L1:
    vertices: [[103.78, 1.3, 0, a], [103.781, 1.3, 0, b]]
    lanes: [[0, 1, {graph_idx: [2, 0], bidirectional: [4, true]}]]
"""
GRID = "type octile\nheight 3\nwidth 4\nmap\n..@.\n.TG.\n....\n"
PROBLEMS = "version 1\n0\tsmall.map\t4\t3\t0\t1\t2\t2\t3.0\n"
SHEET = "image: room.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"
PICTURE = b"P5\n16 16\n255\n" + bytes([254] * 256)
TEXTS = [SMALL, NAV, EARTH, GRID, PROBLEMS, SHEET, MODEL, CSV, *(json.dumps(d) for d in (LIF, lif_2(), SITE, ROUTE, LINK))]
CORPUS_TEXTS = [f.read_text() for f in sorted(MAPS.rglob("*.yaml")) if f.stat().st_size < 12_000]

WORD = re.compile(r"[^\s,\[\]{}:]+")
JUNK = [
    "",
    "null",
    "-1",
    "1e400",
    ".nan",
    ".inf",
    "99999999999999999999",
    "[]",
    "{}",
    "'",
    '"',
    "[",
    "{",
    ": ",
    "- ",
    "&a",
    "*a",
    "!!set",
    "%",
]
JUNK += [
    "true",
    "~",
    "0",
    "1e-300",
    "L9",
    "\t",
    "\n",
    "\u0000",
    "\ud7ff",
    "<<<<<<<",
    "---\n",
    "0x7fffffffffffffff",
    "a" * 300,
    "[[[[[[",
    "2001-01-01",
    "=",
    "<<",
]


@st.composite
def mutilated(draw):
    text = draw(st.sampled_from(TEXTS + CORPUS_TEXTS))
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(text)))
        how = draw(st.sampled_from(["word", "word", "word", "word", "insert", "cut", "swap", "end", "repeat"]))
        junk = draw(st.sampled_from(JUNK) | st.integers(-(10**6), 10**6).map(str))
        to = at + draw(st.integers(1, 30))
        if how == "insert":
            text = text[:at] + junk + text[at:]
        elif how == "word":
            words = [match.span() for match in WORD.finditer(text)]
            (start, end), (a, b) = (words[draw(st.integers(0, len(words) - 1))] for _ in range(2)) if words else ((0, 0), (0, 0))
            text = text[:start] + draw(st.sampled_from([junk, text[a:b], ""])) + text[end:]
        elif how == "cut":
            text = text[:at] + text[to:]
        elif how == "swap":
            text = text[:at] + text[at:to][::-1] + text[to:]
        elif how == "repeat":
            text = text[:to] + text[at:to] + text[to:]
        else:
            text = text[:at]
    return text


def survive(path):
    try:
        map_ = load_map(path)
    except MapError as error:
        assert str(error)
        assert "\n" not in str(error)
        return
    assert map_.nav.num_vertices > 0
    facts(map_)


@settings(max_examples=250, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(mutilated())
def test_mutilated_text_gives_a_map_or_one_line(tmp_path_factory, text):
    folder = tmp_path_factory.getbasetemp() / "fuzz"
    folder.mkdir(exist_ok=True)
    (folder / "room.pgm").write_bytes(PICTURE)
    (folder / "small.map").write_text(GRID)
    path = folder / "subject.yaml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    survive(path)


@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(st.binary(max_size=300))
def test_bytes_give_one_line(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "bytes.yaml"
    path.write_bytes(data)
    survive(path)


@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(st.integers(0, len(PICTURE)), st.binary(max_size=12))
def test_damaged_pictures_give_a_map_or_one_line(tmp_path_factory, at, data):
    folder = tmp_path_factory.getbasetemp() / "pictures"
    folder.mkdir(exist_ok=True)
    (folder / "room.pgm").write_bytes(PICTURE[:at] + data + PICTURE[at + len(data) // 2 :])
    (folder / "room.yaml").write_text(SHEET)
    survive(folder / "room.yaml")


@pytest.mark.campaign
@settings(max_examples=20_000, deadline=None, suppress_health_check=list(HealthCheck))
@given(mutilated())
def test_mutilated_text_for_a_long_time(tmp_path_factory, text):
    test_mutilated_text_gives_a_map_or_one_line.hypothesis.inner_test(tmp_path_factory, text)
