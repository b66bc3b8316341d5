"""Vehicles that cannot turn in place, at work: orders, loads, chargers, breakdowns, shifts, on the plant, drawn roads and real maps.

Runs are judged by the three audits, as those of `operations` are; a run that ends before its time, but for a battery that is empty or a
plan that is missing, has to say who waits for whom.
"""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from campaigns.operations import BATTERY, Operations, drawn
from campaigns.vehicles import PLANNERS, drawn_nav, drawn_types, real_maps

from mrp_sumo.core.fleet import fleet_of_types
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.maps.catalogue import bundled_maps
from mrp_sumo.maps.chains import chains_of
from mrp_sumo.maps.clearance import narrow, pruned
from mrp_sumo.maps.lif_file import write_lif
from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.repair import join_short
from mrp_sumo.maps.roadmap import cell_that_fits, cut_lanes
from mrp_sumo.traffic.draw import stands_of

LOADED = {"speed_mps": 0.8, "accel_mps2": 0.8, "decel_mps2": 0.9, "length_m": 1.2, "width_m": 1.1}  # shares of figures without


class WorkingVehicles(Operations):
    """One run a trial."""

    def drawn(self, rng: np.random.Generator, folder: Path) -> tuple[str, dict[str, Any] | None]:
        types = drawn_types(rng)
        shapes = [with_work(rng, each) for each in types]
        one_of_each = fleet_of_types(types, np.arange(len(types)))
        step_m = 1.01 * max(one_of_each.separation_m, float(one_of_each.behind_m.max()) + 0.1)
        where = rng.random()
        if where < 0.4:
            path = folder / "roads.lif.json"
            nav = drawn_nav(rng, step_m * float(rng.uniform(1.1, 1.8)), curved=where > 0.15)
            write_lif(Map(name="roads", path=path, nav=nav), path)
        else:
            path = bundled_maps()["plant"] if where < 0.7 else real_maps()[int(rng.integers(len(real_maps())))]
        map_ = load_map(path)
        nav, _ = join_short(map_.nav, step_m)
        chains = chains_of(nav)
        lanes_m = (chains.nav if chains else nav).length_m
        if (lanes_m < step_m).any() and one_of_each.behind_m.any():
            return path.parent.name, None
        cell_m = cell_that_fits(lanes_m[lanes_m >= step_m], step_m)
        graph = cut_lanes(nav, cell_m)
        for each in types:
            graph = pruned(graph, narrow(graph, map_.building, each))
        stands = set.intersection(*({*stands_of(graph, anywhere=True, vehicle=each).goal.tolist()} for each in types))
        places = [nav.vertex_name[v] or f"v{v}" for v in sorted(stands) if v < nav.num_vertices]
        if len(places) < 4:
            return path.parent.name, None
        values = drawn(rng, path, places, nav)
        return path.parent.name, at_work(rng, values, shapes, places, cell_m)


def with_work(rng: np.random.Generator, model: RobotType) -> dict[str, Any]:
    """The keys of a type, with what its work needs."""
    shape = {key: value for key, value in asdict(model).items() if value not in (None, (), {}, "") and key not in ("name", "intervals")}
    shape["kinematics"] = {key: value for key, value in shape["kinematics"].items() if value is not None}
    if shape["kinematics"]["kind"] in ("differential", "omni"):
        shape["kinematics"] = {"kind": shape["kinematics"]["kind"]}
    if model.trailers:
        shape["trailers"] = [{key: value for key, value in each.items() if value is not None} for each in shape["trailers"]]
    of_type = {"speed_mps": model.max_speed_mps, **{key: getattr(model, key) for key in list(LOADED)[1:]}}
    if rng.random() < 0.6:
        shape["loaded"] = {key: round(share * of_type[key], 3) for key, share in LOADED.items() if rng.random() < 0.6}
    if rng.random() < 0.6:
        shape["actions"] = {"pick": {"triangular_s": [5, 8, 15]}, "drop": {"constant_s": 6}}
    if rng.random() < 0.4:
        shape |= {"mtbf_h": 0.05, "mttr_h": 0.01} | ({"tow_s": 20} if rng.random() < 0.6 else {})
    if rng.random() < 0.3:
        shape["maintenance"] = {"every_h": 0.05, "takes_s": 30}
    if rng.random() < 0.3:
        shape["capacity"] = int(rng.integers(2, 4))
    return shape


def at_work(
    rng: np.random.Generator, values: dict[str, Any], shapes: list[dict[str, Any]], places: list[str], cell_m: float
) -> dict[str, Any]:
    """A scenario of `operations` for these types."""
    count, tasks = values["robots"]["count"], values["tasks"]
    if "charging" in tasks:
        for shape in shapes:
            shape["battery"] = BATTERY | {"capacity_ah": float(rng.choice([0.5, 5.0]))}
        tasks["charging"] |= {"swap_s": 30} if rng.random() < 0.3 else {}
    others = count // 2 if len(shapes) > 1 else 0
    counts = [count - others, others]
    values["robots"] = {"fleet": [{"type": shape, "count": each} for shape, each in zip(shapes, counts) if each]}
    values["discretisation"] = {"kind": "roadmap", "cell_m": cell_m, "clearance": "prune", "short_lanes": "drive"}
    values["planner"] = str(rng.choice(PLANNERS))
    if any("capacity" in shape for shape in shapes):
        values["execution"]["dispatcher"] = "bundle"
    stations = {}
    for place in {place for group in tasks["groups"].values() for place in group}:
        more: dict[str, Any] = {"queue": [str(rng.choice(places))]} if rng.random() < 0.2 else {}
        more |= {"shifts": [{"begin_h": 0.0, "end_h": 0.05}, {"begin_h": 0.06, "end_h": 12}]} if rng.random() < 0.3 else {}
        more |= {"charges": True} if "charging" in tasks and rng.random() < 0.2 else {}
        stations[f"at {place}"] = {"places": [place]} | more
    tasks["groups"] = {name: [f"at {place}" for place in group] for name, group in tasks["groups"].items()}
    tasks["stations"] = stations
    if rng.random() < 0.3:
        tasks["parking"] = rng.permutation(places)[:3].tolist()
    if rng.random() < 0.3:
        tasks["retry"] = {"times": 1} if rng.random() < 0.5 else {"hand_over": True}
    return values
