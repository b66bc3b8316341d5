"""Lifelong runs on all maps, each judged by the three audits: the referee, bodies, and operations.

Everything about a run is drawn from its number: the map (bundled ones and the corpora that are there), robots, orders between named
places, dispatcher, planner, engine, steps and budgets, and, each with some chance, batteries with chargers, people, breakdowns, outages of
lifts and rules of doors. A fault is a finding of an audit, or a traceback; what a scenario may not ask for is refused and counts as such.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from campaigns.driver import Trial

from mrp_sumo.drive.dispatchers import ONE_SHOT, OURS
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.run import carry_out
from mrp_sumo.io.scenario.read import scenario_of
from mrp_sumo.maps.catalogue import bundled_maps
from mrp_sumo.maps.load import load_map

MAPS = Path(__file__).resolve().parents[3] / "shared" / "maps"
PLANNERS = ("lacam", "prioritised", "pbs", "auto")
DISPATCHERS = tuple(name for name in OURS if name != ONE_SHOT)
UNEXPLAINED = ("stalled", "planner_stalled", "deadlock")  # ends that need a reason
LARGEST = 6000  # lanes of a map as drawn
BATTERY = {"voltage_v": 12.0, "charging_a": 40.0, "mass_kg": 20.0, "inertia_kgm2": 1.0, "friction": 0.2, "device_w": 10.0}
SMALL = {"length_m": 0.3, "width_m": 0.3, "max_speed_mps": 0.8, "accel_mps2": 0.8, "decel_mps2": 1.0, "turn_rate_rad_s": 1.5}


class Operations:
    """One run a trial."""

    size = None
    _maps: MapCache | None = None  # of each child its own, since it counts its files

    def __init__(self, seed: int) -> None:
        self._first, self._paths = seed * 10_000_000, sorted({*bundled_maps().values(), *MAPS.rglob("*.building.yaml")})
        self._nav: dict[Path, Any] = {}

    def trial(self, number: int, folder: Path) -> Trial:
        rng = np.random.default_rng([self._first + number, 81])
        try:
            where, values = self.drawn(rng, folder)
            if values is None:
                return Trial(where, "no places")
            (folder / "scenario.json").write_text(json.dumps(values, indent=1))
            self._maps = self._maps or MapCache()
            result = carry_out(scenario_of(values, folder, "operations"), self._maps)
        except MrpSumoError as error:  # such as places that walls cut off
            return Trial("refused", f"{' '.join(str(error).split(': ', 2)[-1].split()[:3])}")
        work, bodies = result.operations_audit or {"findings": []}, result.audit
        faults = [f"{finding['rule']}: {finding['text']}" for finding in work["findings"]]
        if bodies is not None and not bodies["passed"]:
            faults.append(f"bodies: {result.note}")
        if result.status in UNEXPLAINED and not result.note:
            faults.append(f"{result.status} without a reason")
        kind = f"{values['execution']['dispatcher']}, {values['planner']}"
        return Trial(kind, result.status, tuple(faults), "mrp-sumo run scenario.json --out run")

    def drawn(self, rng: np.random.Generator, folder: Path) -> tuple[str, dict[str, Any] | None]:
        """The folder of a map, and the values of a scenario; None where it has too few places."""
        path = self._paths[int(rng.integers(len(self._paths)))]
        places = self._places(path)
        return path.parent.name, drawn(rng, path, places, self._nav[path]) if len(places) >= 4 else None

    def _places(self, path: Path) -> list[str]:
        """Names of vertices that can all be reached from each other."""
        if path not in self._nav:
            try:
                self._nav[path] = load_map(path).nav
            except MrpSumoError:  # damaged, or without lanes
                self._nav[path] = None
        nav = self._nav[path]
        if nav is None or nav.num_lanes > LARGEST:
            return []
        from mrp_sumo.core.digraph import strong_components

        piece = strong_components(nav.num_vertices, nav.tail, nav.head)
        mine = np.flatnonzero(piece == np.bincount(piece).argmax()).tolist()
        names = [nav.vertex_name[v] for v in mine if nav.vertex_name[v] and nav.vertex_of_name[nav.vertex_name[v]] == v]
        return names if len(names) > 5 else [f"v{v}" for v in mine]


def drawn(rng: np.random.Generator, path: Path, places: list[str], nav: Any) -> dict[str, Any]:
    """The values of a scenario."""

    def some(count: int) -> list[str]:
        return rng.permutation(places)[:count].tolist()

    def chance(share: float) -> bool:
        return bool(rng.random() < share)

    robots, ends = int(rng.integers(1, 7)), [some(int(rng.integers(1, 4))), some(int(rng.integers(1, 4)))]
    service = [{"constant_s": float(rng.choice([0.0, 3.0, 20.0]))}, {"triangular_s": [2.0, 4.0, 9.0]}]
    arrivals = {"open": int(rng.integers(1, 2 * robots + 2))} if chance(0.4) else {"rate_per_h": float(rng.choice([40.0, 150.0, 400.0]))}
    streams = [{"name": "a", "stops": ["from", "to"], "service": service, "arrivals": arrivals}]
    if chance(0.3):
        streams.append({"name": "b", "stops": ["to"], "service": [5.0], "arrivals": {"rate_per_h": 60.0}, "priority": int(rng.integers(3))})
    tasks: dict[str, Any] = {"groups": {"from": ends[0], "to": ends[1]}, "streams": streams}
    shape: Any = "turtlebot3" if chance(0.3) else dict(SMALL)
    if chance(0.4):
        shape = shape if isinstance(shape, str) else shape | {"battery": BATTERY | {"capacity_ah": float(rng.choice([0.2, 0.5, 5.0]))}}
        start = sorted(rng.uniform(20, 100, 2).round().tolist())
        charging = {"stations": some(int(rng.integers(1, 4))), "critical_low_charging_level": 40.0, "start_level": start}
        tasks["charging"] = charging | {"policy": str(rng.choice(["threshold", "opportunity"])), "minimum_desired_charging_level": 60.0}
    step_s = float(rng.choice([0.1, 0.1, 0.2, 0.5]))
    execution: dict[str, Any] = {
        "engine": "sumo" if chance(0.15) else "kinematic",
        "dispatcher": str(rng.choice(DISPATCHERS)),
        "time_limit_s": float(rng.choice([200.0, 400.0, 600.0])),
        "step_length_s": step_s,
        "planning": {"budget_s": float(rng.choice([0.0, 1.0, 3.0]))},
        "on_deadlock": str(rng.choice(["report", "resolve"])),
        "disturbances": {},
    }
    if chance(0.3):
        broken = {"robot": int(rng.integers(robots)), "begin_s": float(rng.uniform(0, 150))}
        execution["disturbances"]["breakdowns"] = [broken | ({"duration_s": 40.0} if chance(0.6) else {})]
    if chance(0.5) and nav.is_ride.any():
        execution["disturbances"]["lift_rides_per_h"] = 30.0
    if chance(0.5):
        execution["doors"] = "automatic"
    people = {"people": {"count": int(rng.integers(1, 8))}} if chance(0.15) else {}
    return {
        "map": str(path),
        "discretisation": {"kind": str(rng.choice(["grid", "roadmap"])), "cell_m": float(rng.choice([0.6, 1.0])), "clearance": "prune"},
        "robots": {"count": robots, "type": shape},
        "seed": int(rng.integers(1000)),
        "planner": str(rng.choice(PLANNERS)),
        "tasks": tasks,
        "execution": execution,
        "record": {"bag": False, "period_s": step_s},
        **people,
    }
