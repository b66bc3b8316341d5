"""Graphs and fleet of a run, kept in the run folder so that logs can be derived when the map is gone.

`floor.json`: the nav graph, the plan graph and the fleet; `map.png` with `map.yaml`: the walls, in the
form that Nav2's map_server reads. Reading them back gives the same arrays. Refuses files of another schema.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from mrp_sumo.core.fleet import LIMITS, Fleet, fleet_of_types
from mrp_sumo.core.graph import NO_PROPERTIES, NavGraph, PlanGraph, frozen, nav_graph, plan_graph
from mrp_sumo.core.robot_type import OF_LOADED, Loaded, RobotType, Trailer, Wheels
from mrp_sumo.errors import MrpSumoError, first_line
from mrp_sumo.files.reading import read_head, read_json, require_regular
from mrp_sumo.maps.yaml_text import parse
from mrp_sumo.maps.yaml_text import read_text as read_map_text

if TYPE_CHECKING:
    from mrp_sumo.maps.costmap import Costmap
    from mrp_sumo.maps.map import Map

SCHEMA_VERSION = 1
FARTHEST_M = 1e9
LONGEST_M = 1e6  # of a lane, which is cut into pieces of a robot's size


def write_floor(path: Path, graph: PlanGraph, fleet: Fleet, nav: NavGraph | None) -> None:
    about: dict[str, Any] = {"kind": graph.kind, "cell_m": graph.cell_m, "vertex_of_station": graph.vertex_of_station.tolist()}
    about |= {"beyond_m": graph.beyond_m.tolist()} if len(graph.beyond_m) else {}
    about |= {"curves": [[*lane, places.tolist()] for lane, places in graph.curves.items()]} if graph.curves else {}
    document = {
        "schema_version": SCHEMA_VERSION,
        "units": "m, s, rad",
        "fleet": {"robot_name": list(fleet.robot_name), **_limits(fleet), **({"loaded": _limits(fleet.loaded)} if fleet.loaded else {})},
        "plan_graph": {**_graph_document(graph), **about},
        "nav_graph": _graph_document(nav) if nav is not None else None,
    }
    if fleet.vehicle_of_kind:
        shapes = [{"kinematics": asdict(each.kinematics), "trailers": [*map(asdict, each.trailers)]} for each in fleet.types]
        document["vehicles"] = {"kind": fleet.kind.tolist(), "name": [each.name for each in fleet.types], "shape": shapes}
    path.write_text(json.dumps(document, separators=(",", ":"), ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")


def read_floor(path: Path) -> tuple[PlanGraph, Fleet, NavGraph | None]:
    """Read `floor.json` back. Raises MrpSumoError for a file that is missing, damaged, or of another schema."""
    document = read_json(path)
    version = document.get("schema_version") if isinstance(document, dict) else None
    if version != SCHEMA_VERSION:
        raise MrpSumoError(f"{path}: schema version {version}, expected {SCHEMA_VERSION}")
    plan, fleet, nav = document["plan_graph"], document["fleet"], document["nav_graph"]
    graph = plan_graph(_graph(plan), kind=plan["kind"], cell_m=plan["cell_m"], vertex_of_station=plan["vertex_of_station"])
    curves = {(tail, head): frozen(np.array(places, np.float64).reshape(-1, 4)) for tail, head, places in plan.get("curves", ())}
    if not set(curves) <= set(zip(graph.tail.tolist(), graph.head.tolist())):
        raise ValueError("a curve is along no lane")
    if not all(np.isfinite(each).all() and (np.diff(each[:, 0]) >= 0).all() and each[-1:, 0].sum() > 0 for each in curves.values()):
        raise ValueError("a curve is not places at growing distances")
    graph = replace(graph, curves=curves, beyond_m=frozen(np.array(plan.get("beyond_m", ()), np.float64)))
    return graph, _fleet(fleet, document.get("vehicles")), _graph(nav) if nav else None


def _texts(names: Sequence[str]) -> tuple[str, ...]:
    for name in names:
        if not isinstance(name, str):
            raise TypeError(f"a name is {str(name)[:40]}, expected text")
    return tuple(names)


def _fleet(document: dict[str, Any], vehicles: dict[str, Any] | None) -> Fleet:
    """Robots with equal figures are of one type."""
    both = [document, document.get("loaded", document)]
    columns = np.array([each[key] for each in both for key in LIMITS], np.float64).T
    if vehicles is not None:
        of_kind = dict(zip(vehicles["kind"], columns.tolist()))
        made = [
            replace(
                _type(name, of_kind[k], has_loads="loaded" in document),
                kinematics=Wheels(**shape["kinematics"]),
                trailers=tuple(Trailer(**each) for each in shape["trailers"]),
            )
            for k, (name, shape) in enumerate(zip(vehicles["name"], vehicles["shape"]))
        ]
        return replace(fleet_of_types(made, np.array(vehicles["kind"], np.int64)), robot_name=_texts(document["robot_name"]), type_name=())
    rows, kind = np.unique(columns, axis=0, return_inverse=True)
    types = [_type("", row, has_loads="loaded" in document) for row in rows.tolist()]
    return replace(fleet_of_types(types, kind.reshape(-1)), robot_name=_texts(document["robot_name"]), type_name=())


def _type(name: str, figures: Sequence[float], *, has_loads: bool) -> RobotType:
    """A type with the limits of robots without a load, and then of those with one."""
    without, with_load = dict(zip(LIMITS, figures)), dict(zip(LIMITS, figures[len(LIMITS) :]))
    keys = [key for key in Loaded.__dataclass_fields__ if key != "mass_kg"]
    return RobotType(name, **without, loaded=Loaded(**{key: with_load[OF_LOADED.get(key, key)] for key in keys}) if has_loads else None)


def _limits(fleet: Fleet) -> dict[str, Any]:
    return {key: getattr(fleet, key).tolist() for key in LIMITS}


def write_costmap(folder: Path, name: str, costmap: "Costmap") -> None:
    """Write `NAME.png` and `NAME.yaml` into a folder, as ROS has maps."""
    from PIL import Image

    Image.fromarray(~costmap.occupied[::-1]).save(folder / f"{name}.png")  # a picture's first row is the highest y
    about = {
        "image": f"{name}.png",
        "mode": "trinary",
        "resolution": float(costmap.resolution_m),
        "origin": [*map(float, costmap.origin_m), 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.25,
    }
    (folder / f"{name}.yaml").write_text(yaml.safe_dump(about, sort_keys=False), encoding="utf-8")


def write_walls(map_: "Map", folder: Path) -> None:
    """Write `NAME.building.yaml` into a folder: the walls of a plan to draw lanes on, over its picture, if it is one, `NAME_plan.png`."""
    from PIL import Image

    from mrp_sumo.maps.building_file import building_document
    from mrp_sumo.maps.readers.reader import HEAD, plan_kind
    from mrp_sumo.maps.yaml_edit import text_of

    picture, kind = None, plan_kind(read_head(map_.path, HEAD))
    if kind == "pdf" and map_.floor is not None:  # of its page, the floor is what is left
        height, width = map_.floor.occupied.shape
        picture = (f"{map_.name}_map.png", width, height)
    elif kind == "picture":
        with Image.open(map_.path) as image:
            picture = (f"{map_.name}_plan.png", image.width, image.height)
            image.convert("RGBA" if "transparency" in image.info or "A" in image.getbands() else "RGB").save(folder / picture[0])
    document = building_document(map_, picture=picture, with_lanes=False)
    (folder / f"{map_.name}.building.yaml").write_text(text_of(document), encoding="utf-8")


def read_walls(folder: Path) -> "Costmap | None":
    """The walls of a run folder; None where it has none. Raises MrpSumoError where they are damaged."""
    from PIL import Image

    from mrp_sumo.maps.costmap import Costmap

    path = folder / "map.yaml"
    if not path.is_file():
        return None
    try:
        about = parse(read_map_text(path))
        image_file = folder / str(about["image"])
        require_regular(image_file)
        with Image.open(image_file) as image:
            occupied = np.asarray(image.convert("L"))[::-1] < 128
        x_m, y_m, resolution_m = (float(value) for value in (*about["origin"][:2], about["resolution"]))
        if not (abs(x_m) < FARTHEST_M and abs(y_m) < FARTHEST_M and 0 < resolution_m < FARTHEST_M):
            raise MrpSumoError(f"origin {x_m:g}, {y_m:g} m and resolution {resolution_m:g} m are no place and size of cells")
        return Costmap((x_m, y_m), resolution_m, frozen(occupied))
    except Exception as error:  # Pillow's decoders raise anything on damaged files
        raise MrpSumoError(f"{path}: no map of walls: {first_line(error)}") from None


def _graph_document(graph: NavGraph) -> dict[str, Any]:
    """Names are kept for the vertices that have one; lanes as pairs, lengths where they are not straight."""
    straight = np.hypot(*(graph.xy[graph.head] - graph.xy[graph.tail]).T) if graph.num_lanes else np.zeros(0)
    return {
        "name": graph.name,
        "level_names": list(graph.level_names),
        "xy": graph.xy.tolist(),
        "level": graph.level.tolist() if graph.level.any() else None,
        "vertex_name": {str(v): name for v, name in enumerate(graph.vertex_name) if name},
        "vertex_options": {str(v): dict(options) for v, options in enumerate(graph.vertex_options) if options},
        "lanes": np.column_stack((graph.tail, graph.head)).tolist(),
        "length_m": graph.length_m.tolist() if not np.array_equal(straight, graph.length_m) else None,
    }


def _graph(document: dict[str, Any]) -> NavGraph:
    names, options = document["vertex_name"], document.get("vertex_options", {})
    _texts([document["name"], *document["level_names"], *names.values()])
    for of_vertex in options.values():
        if not isinstance(of_vertex, dict):
            raise TypeError(f"options of a vertex are {of_vertex!r:.40}, expected keys and values")
    if not set(document["level"] or ()) <= set(range(len(document["level_names"]))):
        raise ValueError("a vertex is on no level")
    if document["level"] is not None and len(document["level"]) != len(document["xy"]):
        raise ValueError(f"levels of {len(document['level'])} vertices, expected {len(document['xy'])}")
    graph = nav_graph(
        name=document["name"],
        level_names=document["level_names"],
        xy=document["xy"],
        level=document["level"],
        vertex_name=[names.get(str(v), "") for v in range(len(document["xy"]))],
        vertex_options=[options.get(str(v), NO_PROPERTIES) for v in range(len(document["xy"]))],
        lanes=document["lanes"],
        length_m=document["length_m"],
    )
    longest_m = np.hypot(*(graph.xy[graph.head] - graph.xy[graph.tail]).T).max(initial=0.0)
    if not longest_m < LONGEST_M:
        raise ValueError(f"a lane of {longest_m:g} m, expected less than {LONGEST_M:g} m")
    return graph
