"""The bundled maps have the key facts they promise, and are drawn so that robots can pass."""

import importlib.util
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from mrp_sumo.maps.grid import paper_grid
from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.roadmap import cut_lanes

ROOT = Path(__file__).resolve().parents[1]
NAMES = ("office", "warehouse", "airport", "hospital")


@cache
def level(name: str) -> dict[str, Any]:
    text = (ROOT / "networks" / name / f"{name}.building.yaml").read_text()
    return yaml.safe_load(text)["levels"]["L1"]


@cache
def geometry(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices [V, 2] in m, lanes [L, 2], walls [W, 2], read by the format's rules."""
    drawn = level(name)
    pixels = np.array([v[:2] for v in drawn["vertices"]], np.float64) * [1, -1]
    scale = np.mean([o["distance"][1] / np.hypot(*(pixels[a] - pixels[b])) for a, b, o in drawn["measurements"]])
    return pixels * scale, np.array([lane[:2] for lane in drawn["lanes"]]), np.array([wall[:2] for wall in drawn["walls"]])


def distance(p: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """[N] from points [N, 2] to segments [N, 2]."""
    t = np.clip(((p - a) * (b - a)).sum(-1) / ((b - a) ** 2).sum(-1), 0, 1)[..., None]
    return np.hypot(*np.moveaxis(p - a - t * (b - a), -1, 0))


def cross(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """[N] whether segments a-b and c-d [N, 2] cross in their interiors."""

    def side(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
        area = (q[:, 0] - p[:, 0]) * (r[:, 1] - p[:, 1]) - (q[:, 1] - p[:, 1]) * (r[:, 0] - p[:, 0])
        return np.where(np.abs(area) < 1e-9, 0, np.sign(area))

    return (side(a, b, c) * side(a, b, d) < 0) & (side(c, d, a) * side(c, d, b) < 0)


@pytest.mark.parametrize(
    ("name", "num_vertices", "num_edges", "extent_m"),
    [
        ("office", 29, 32, (21.5, 12.0)),
        ("warehouse", 54, 59, (22.0, 27.0)),
        ("airport", 210, 244, (282.0, 64.0)),
        ("hospital", 93, 109, (38.4, 24.0)),
    ],
)
def test_map_has_the_key_facts_it_promises(name: str, num_vertices: int, num_edges: int, extent_m: tuple[float, float]) -> None:
    xy, lanes, walls = geometry(name)
    assert len(np.unique(lanes)) == num_vertices
    assert len({tuple(sorted(lane)) for lane in lanes.tolist()}) == len(lanes) == num_edges
    assert np.ptp(xy[walls.ravel()], axis=0) == pytest.approx(extent_m)
    readme = (ROOT / "networks" / name / "README.md").read_text()
    assert f"| vertices | {num_vertices} |" in readme
    assert f"| edges | {num_edges} |" in readme


@pytest.mark.parametrize("name", NAMES)
def test_map_is_one_piece(name: str) -> None:
    _, lanes, _ = geometry(name)
    reached = {int(lanes[0, 0])}
    while grown := {v for lane in lanes.tolist() if reached & set(lane) for v in lane} - reached:
        reached |= grown
    assert reached == set(lanes.ravel().tolist())


@pytest.mark.parametrize("name", NAMES)
def test_robots_can_pass_each_other(name: str) -> None:
    xy, lanes, walls = geometry(name)
    length_m = np.hypot(*(xy[lanes[:, 0]] - xy[lanes[:, 1]]).T)
    assert length_m.min() >= 0.9
    assert (length_m / np.maximum(1, np.rint(length_m / 0.4))).min() >= 0.37  # no step shorter than two robots and their gap

    vertices = np.unique(lanes)
    v, k = (i.ravel() for i in np.meshgrid(vertices, np.arange(len(lanes)), indexing="ij"))
    apart = (lanes[k] != v[:, None]).all(1)
    assert distance(xy[v], xy[lanes[k, 0]], xy[lanes[k, 1]])[apart].min() >= 0.8

    i, j = (i.ravel() for i in np.meshgrid(np.arange(len(lanes)), np.arange(len(walls)), indexing="ij"))
    ends = [(lanes[i, e], walls[j, 0], walls[j, 1]) for e in (0, 1)] + [(walls[j, e], lanes[i, 0], lanes[i, 1]) for e in (0, 1)]
    assert min(distance(xy[p], xy[a], xy[b]).min() for p, a, b in ends) >= 0.5


@pytest.mark.parametrize("name", NAMES)
def test_no_lane_crosses_a_wall_or_another_lane(name: str) -> None:
    xy, lanes, walls = geometry(name)
    for others in (lanes, walls):
        i, j = (i.ravel() for i in np.meshgrid(np.arange(len(lanes)), np.arange(len(others)), indexing="ij"))
        assert not cross(xy[lanes[i, 0]], xy[lanes[i, 1]], xy[others[j, 0]], xy[others[j, 1]]).any()


@pytest.mark.parametrize("name", NAMES)
def test_lanes_meet_at_sixty_degrees_or_more(name: str) -> None:
    xy, lanes, _ = geometry(name)
    both = np.concatenate([lanes, lanes[:, ::-1]])
    bearing = np.degrees(np.arctan2(*(xy[both[:, 1]] - xy[both[:, 0]]).T))
    for vertex in np.unique(lanes):
        surroundings = np.sort(bearing[both[:, 0] == vertex])
        if len(surroundings) > 1:
            assert np.diff(np.append(surroundings, surroundings[0] + 360)).min() >= 60


@pytest.mark.parametrize("name", NAMES)
def test_stations_have_names_of_their_own(name: str) -> None:
    drawn = level(name)
    used = np.unique(geometry(name)[1])
    names = [drawn["vertices"][v][3] for v in used if drawn["vertices"][v][3]]
    assert len(set(names)) == len(names) >= len(used) / 2
    assert all(drawn["vertices"][v][3] for v in used if len(drawn["vertices"][v]) > 4)
    assert sum("is_charger" in v[4] for v in drawn["vertices"] if len(v) > 4) >= 3


def test_script_draws_the_same_bytes_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    spec = importlib.util.spec_from_file_location("make_networks", ROOT / "tools" / "make_networks.py")
    assert spec and spec.loader
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    monkeypatch.setattr("sys.argv", ["make_networks.py", str(tmp_path)])
    script.main()
    assert "210 vertices, 244 edges" in capsys.readouterr().out
    for name in NAMES:
        file = Path(name) / f"{name}.building.yaml"
        assert (tmp_path / file).read_bytes() == (ROOT / "networks" / file).read_bytes()


def test_kiva_map_is_drawn_by_its_rule() -> None:
    nav = load_map(ROOT / "networks" / "kiva" / "kiva.map").nav
    rows = (ROOT / "networks" / "kiva" / "kiva.map").read_text().splitlines()[4:]
    assert len(rows) == 33 and {len(row) for row in rows} == {46}
    assert sum(row.count("@") for row in rows) == 240 and nav.num_vertices == 33 * 46 - 240 and nav.num_components == 1
    text = (ROOT / "scenarios" / "kiva_lifelong.yaml").read_text()
    scenario = yaml.safe_load(text)
    endpoints = {int(name[1:]) for name in scenario["tasks"]["groups"]["endpoint"]}
    homes = {int(name[1:]) for name in scenario["robots"]["starts"]}
    cell = np.rint(nav.xy / 0.4 - 0.5).astype(int)  # column, row from the lowest
    assert len(endpoints) == 480 and not endpoints & homes
    assert {(v - 1) % 2 for v in cell[sorted(endpoints), 1].tolist()} == {0}  # beside the pods' middle rows
    for v in endpoints:
        column, row = cell[v]
        assert "@" in (rows[32 - row - 1][column], rows[32 - row + 1][column])
    assert set(cell[sorted(homes), 0].tolist()) <= {1, 2, 4, 5, 40, 41, 43, 44}


@pytest.mark.parametrize("name", NAMES)
def test_map_is_read_without_findings(name: str) -> None:
    map_ = load_map(ROOT / "networks" / name / f"{name}.building.yaml")
    assert map_.findings == ()
    assert map_.nav.num_components == 1
    assert (map_.nav.reverse >= 0).all()


@pytest.mark.parametrize("name", NAMES)
def test_both_discretisations_are_one_piece(name: str) -> None:
    nav = load_map(ROOT / "networks" / name / f"{name}.building.yaml").nav
    for graph in (paper_grid(nav, 0.4), cut_lanes(nav, 0.4)):
        assert graph.num_components == 1
        assert len(set(graph.vertex_of_station.tolist())) == nav.num_vertices


def test_the_plant_is_the_same_as_lif_and_as_a_plant_model() -> None:
    """And drawn so that nothing about either is to be reported."""
    lif, tcs = (load_map(ROOT / "networks" / "plant" / f"plant{suffix}") for suffix in (".lif.json", ".xml"))
    assert (lif.findings, tcs.findings) == ((), ())
    assert sum(bool(name) for name in lif.nav.vertex_name) == 26
    named = [[name for name in map_.nav.vertex_name if name] for map_ in (lif, tcs)]
    assert named[0] == named[1]
    assert lif.nav.length_m.sum() == pytest.approx(tcs.nav.length_m.sum(), abs=0.1)
    assert tcs.nav.having("mutex").sum() == 2


def test_the_levels_of_the_hospital_lie_on_each_other_and_are_joined_by_its_lifts() -> None:
    map_ = load_map(ROOT / "networks" / "hospital_levels" / "hospital_levels.building.yaml")
    nav, rides = map_.nav, {options["lift"] for options in map_.nav.lane_options if "lift" in options}
    assert map_.building is not None and not map_.findings and nav.num_components == 1 and rides == {"lift_west", "lift_east"}
    there = [nav.xy[nav.vertex_of_name[f"{level}_lift_west"]] - map_.level_shift_m[level] for level in ("L1", "L2", "L3")]
    assert np.ptp(there, axis=0) == pytest.approx(0, abs=1e-6)
    assert [level.elevation_m for level in map_.building.levels.values()] == [0.0, 4.2, 8.4]
    hatch = {name for level in map_.building.levels.values() for name in (door.name for door in level.doors)}
    assert len(hatch) == 30
