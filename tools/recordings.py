"""Recordings of people that others have made, as arrays. They are fetched by who wants them; their own terms hold.

HERMES (Forschungszentrum Juelich, 2009), `datasets/HERMES` of github.com/crowdbotp/OpenTraj: `uo-BBB-WWW-EEE.txt` are people who walk one
way through a corridor of WWW cm, whose exit is EEE cm wide; those of `bo*-WWW-*.txt` walk both ways. CITR (The Ohio State University),
github.com/dongfang-steven-yang/vci-dataset-citr: `data/trajectories_filtered/vci_*` are people who meet a golf cart.
"""

import csv
from collections import defaultdict
from pathlib import Path

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray

FRAME_S, CART_FRAME_S = 1 / 16, 1 / 29.97
CART_M = 2.4, 1.2  # length and width of a golf cart, roughly
SECTION_M = (0.0, 2.0)  # along the corridor, in which people are counted
HALF = 8  # frames: speeds are over a second
PASSED_M = -5.0  # beyond the exit


def corridors(folder: Path) -> list[Path]:
    """Files of HERMES of people who walk one way, by name."""
    return sorted(folder.rglob("uo-???-???-???.txt"))


def two_way_corridors(folder: Path) -> list[Path]:
    """Files of HERMES of people who walk both ways, by name."""
    return sorted(folder.rglob("bo*-???-*.txt"))


def corridor_m(path: Path) -> float:
    """Width of the corridor of a file."""
    return int(path.stem.split("-")[2 if path.stem.startswith("uo") else 1]) / 100


def exit_m(path: Path) -> float:
    """Width of its exit."""
    return int(path.stem.split("-")[3]) / 100


def tracks(path: Path) -> tuple[IntArray, IntArray, FloatArray]:
    """Persons and frames [N], and where they are along the corridor in m [N], by person and frame."""
    rows = np.array([line.split()[:4] for line in path.read_text(encoding="utf-8").splitlines() if line.strip()], np.float64)
    rows = rows[np.isfinite(rows).all(1)]
    rows = rows[np.lexsort((rows[:, 1], rows[:, 0]))]
    return rows[:, 0].astype(np.int64), rows[:, 1].astype(np.int64), rows[:, 3] / 100


def sightings(path: Path, least_share: float = 0.0) -> FloatArray:
    """[F, 3] people a square metre, their mean speed in m/s and their number, of each frame with somebody in the section.

    `least_share` of them at least walk either way.
    """
    person, frame, along = tracks(path)
    key = person * 1_000_000 + frame
    before, after = (np.minimum(np.searchsorted(key, key + step), len(key) - 1) for step in (-HALF, HALF))
    there = (key[before] == key - HALF) & (key[after] == key + HALF)
    inside = (along >= SECTION_M[0]) & (along < SECTION_M[1])
    number = frame - frame.min()
    count = np.bincount(number[inside])
    way_m = along[after] - along[before]
    speed = np.abs(way_m) / (2 * HALF * FRAME_S)
    seen = inside & there
    total, num, up = (np.bincount(number[seen], weights, len(count)) for weights in (speed[seen], None, way_m[seen] > 0))
    some = (num > 0) & (np.minimum(up, num - up) >= least_share * num)
    area = corridor_m(path) * (SECTION_M[1] - SECTION_M[0])
    return np.column_stack([count[some] / area, total[some] / num[some], num[some]])


def speed_mps(seen: FloatArray, density: float) -> tuple[float, float, int]:
    """Mean speed and density of people in frames with nearly a density, and their number. NaN where there are none."""
    near = np.abs(seen[:, 0] - density) <= (0.2 if density < 1 else 0.1) * density + 1e-9
    if not near.any():
        return float("nan"), float("nan"), 0
    density_there, speed = (float(np.average(seen[near, k], weights=seen[near, 2])) for k in (0, 1))
    return speed, density_there, int(near.sum())


def passed_s(path: Path) -> list[float]:
    """Times at which people come out of the exit, ascending."""
    person, frame, along = tracks(path)
    out = along < PASSED_M
    first = {int(p): int(f) for p, f in zip(person[out][::-1], frame[out][::-1])}
    return sorted(f * FRAME_S for f in first.values())


def encounters(folder: Path) -> dict[str, list[tuple[dict[int, FloatArray], FloatArray]]]:
    """Encounters of people with a cart by their kind: people as [T, 3] frames and places, and the cart as [V, 5] frames and states."""
    kinds = defaultdict[str, list[tuple[dict[int, FloatArray], FloatArray]]](list)
    for path in sorted(folder.rglob("*_traj_veh_filtered.csv")):
        cart = np.array([[float(row[k]) for k in ("frame", "x_est", "y_est", "psi_est", "vel_est")] for row in _rows(path)])
        walkers = defaultdict[int, list[list[float]]](list)
        for row in _rows(path.with_name(path.name.replace("_veh_", "_ped_"))):
            if cart[0, 0] <= float(row["frame"]) <= cart[-1, 0]:
                walkers[int(row["id"])].append([float(row[k]) for k in ("frame", "x_est", "y_est")])
        kinds[path.parent.name].append(({one: np.array(track) for one, track in walkers.items() if len(track) > 30}, cart))
    return dict(kinds)


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))
