"""Small floors whose work is known by hand: a one-way ring, a tee, a row of stations; and driving them."""

from pathlib import Path

from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.run import carry_out
from mrp_sumo.io.scenario.read import scenario_of

SMALL = {"length_m": 0.4, "width_m": 0.4, "max_speed_mps": 1.0, "accel_mps2": 1.0, "decel_mps2": 1.0, "turn_rate_rad_s": 3.0}
BATTERY = {
    "voltage_v": 10.0,
    "capacity_ah": 0.5,
    "charging_a": 30.0,
    "mass_kg": 20.0,
    "inertia_kgm2": 1.0,
    "friction": 0.2,
    "device_w": 10.0,
}


def lanes(path: Path, xy: dict[str, tuple[float, float]], pairs, both_ways: bool) -> Path:
    """A map of straight lanes between named places, as CSV."""
    rows = [f"{a},{b},{xy[a][0]},{xy[a][1]},{xy[b][0]},{xy[b][1]},{'yes' if both_ways else 'no'}" for a, b in pairs]
    path.write_text("from,to,from_x_m,from_y_m,to_x_m,to_y_m,both_ways\n" + "\n".join(rows) + "\n")
    return path


def ring(folder: Path, side_m: float = 10.0) -> Path:
    """One way around a square: A in the middle of the lower side, B in that of the upper one."""
    half = side_m / 2
    xy = {"c1": (0.0, 0.0), "A": (half, 0.0), "c2": (side_m, 0.0), "c3": (side_m, side_m), "B": (half, side_m), "c4": (0.0, side_m)}
    names = list(xy)
    return lanes(folder / "ring.csv", xy, zip(names, names[1:] + names[:1]), False)


def tee(folder: Path) -> Path:
    """A dead end with a place X off the middle of a street with parking at both ends."""
    xy = {"west": (0.0, 0.0), "mid": (5.0, 0.0), "east": (10.0, 0.0), "X": (5.0, 4.0)}
    return lanes(folder / "tee.csv", xy, [("west", "mid"), ("mid", "east"), ("mid", "X")], True)


def scenario(map_path: Path, tasks, *, robots: int = 1, starts=None, shape=None, **other):
    """A scenario on such a floor: its roadmap of 1 m, bodies of 0.4 m, the kinematic engine unless `execution` says otherwise."""
    execution = {"engine": "kinematic", "time_limit_s": 300.0, **other.pop("execution", {})}
    group = {"starts": starts} if starts else {"count": robots}
    values = {
        "map": str(map_path),
        "discretisation": {"kind": "roadmap", "cell_m": 1.0},
        "robots": {**group, "type": {**SMALL, **(shape or {})}},
        "planner": "lacam",
        "tasks": tasks,
        "execution": execution,
        "record": {"bag": False},
        **other,
    }
    return scenario_of(values, map_path.parent, map_path.stem)


def driven(file):
    """The result of a run."""
    with MapCache() as maps:
        return carry_out(file, maps)


def written(file, out: Path) -> Path:
    """The folder of a run."""
    with MapCache() as maps:
        carry_out(file, maps).write(out, maps)
    return out
