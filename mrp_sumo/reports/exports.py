"""A finished run in other formats: CSV, GeoJSON, SUMO's FCD, bags, and set-ups for viewers.

Everything derives from the record, and is written whole or not at all. Refuses to overwrite.
"""

import json
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import resources
from pathlib import Path
from string import Template
from tempfile import TemporaryDirectory
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from mrp_sumo.core.execution import positions_at
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.files.writing import writing_to
from mrp_sumo.io.events import event_document
from mrp_sumo.io.record import STATE_NAMES, RunRecord, goal_name, robot_states

GEOJSON_PERIOD_S = 1.0
NO_ROS1_TYPE = ("/rosout",)  # rcl_interfaces/Log


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary place beside `path`, renamed to it at the end. Raises MrpSumoError when `path` exists, or the disk refuses."""
    path = path.resolve()
    if path.exists():
        raise MrpSumoError(f"{path}: exists already; choose another place with --out")
    partial = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        with writing_to(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            yield partial
            partial.rename(path)
    finally:
        if partial.is_dir():
            shutil.rmtree(partial, ignore_errors=True)
        else:
            with suppress(OSError):  # it may never have been there, or its folder
                partial.unlink()


def write_csv(path: Path, record: RunRecord) -> None:
    """The trajectory as CSV by time: t_s, robot, x_m, y_m, yaw_rad, speed_mps, state; numbers in full.

    Of a run on several levels also `level`, in whose frame positions are then.
    """
    import pyarrow as pa
    from pyarrow import csv

    from mrp_sumo.io.arrow import numbers

    execution = record.execution
    names, states = pa.array(list(record.fleet.robot_name), pa.string()), pa.array(list(STATE_NAMES), pa.string())
    fields = [("t_s", pa.float64()), ("robot", pa.string())]
    fields += [(name, pa.float64()) for name in ("x_m", "y_m", "yaw_rad", "speed_mps")] + [("state", pa.string())]
    levels = execution.level
    fields += [] if levels is None else [("level", pa.string())]
    level_names = pa.array(list(record.graph.level_names), pa.string())
    num_samples, num_robots = execution.x_m.shape
    ticks = max(1, 200_000 // max(1, num_robots))
    with (
        replacing(path) as partial,
        csv.CSVWriter(partial, pa.schema(fields), write_options=csv.WriteOptions(quoting_style="needed")) as out,
    ):
        for a in range(0, num_samples, ticks):
            rows = slice(a, min(a + ticks, num_samples))
            t_s = np.rint(execution.t_s[rows] * 1e9) / 1e9  # 0.3, not 0.30000000000000004
            there = (np.isfinite(execution.x_m[rows]) & np.isfinite(execution.y_m[rows])).ravel()
            robot = np.tile(np.arange(num_robots), len(t_s))[there]
            columns = [numbers(np.repeat(t_s, num_robots)[there]), names.take(numbers(robot))]
            values = [getattr(execution, name)[rows] for name in ("x_m", "y_m", "yaw_rad", "speed_mps")]
            if levels is not None:
                values[:2] = [place - record.shift_m[levels[rows], axis] for axis, place in enumerate(values[:2])]
            columns += [numbers(each.ravel()[there]) for each in values]
            columns.append(states.take(numbers(robot_states(execution, execution.t_s[rows]).ravel()[there])))
            if levels is not None:
                columns.append(level_names.take(numbers(levels[rows].ravel()[there])))
            out.write_table(pa.Table.from_arrays(columns, schema=pa.schema(fields)))


def write_geojson(path: Path, record: RunRecord) -> None:
    """Vertices, lanes, one line per robot with a time for each point, and events, for GIS programs.

    Coordinates are metres in the map's frame, not degrees; the member `crs_note` says so. Robots are
    sampled once a second; points where they stand still are left out.
    """
    execution, nav = record.execution, record.drawn
    features = [
        _feature("Point", nav.xy[v].tolist(), {"layer": "vertex", "vertex": v, "name": nav.label(v)}) for v in range(nav.num_vertices)
    ]
    for k in np.flatnonzero(nav.is_once).tolist():
        a, b = int(nav.tail[k]), int(nav.head[k])
        about = {"layer": "lane", "from": nav.label(a), "to": nav.label(b), "two_way": bool(nav.reverse[k] >= 0)}
        features.append(_feature("LineString", nav.xy[[a, b]].tolist(), about))
    t_s = np.arange(0, execution.t_s[-1] + 1e-9, GEOJSON_PERIOD_S)
    x, y, _ = positions_at(execution, t_s)
    for r, name in enumerate(record.fleet.robot_name):
        keep = np.isfinite(x[:, r]) & np.isfinite(y[:, r])
        moves = (np.diff(x[:, r]) != 0) | (np.diff(y[:, r]) != 0)
        keep &= np.concatenate(([True], moves)) | np.concatenate((moves, [True]))
        if not keep.any():
            continue
        points, times = np.column_stack((x[keep, r], y[keep, r])).tolist(), t_s[keep].tolist()
        if len(points) == 1:  # a line has two ends
            points, times = points * 2, times * 2
        goal = goal_name(record, r)
        features.append(_feature("LineString", points, {"layer": "trajectory", "robot": name, "goal": goal, "times_s": times}))
    for event in execution.events:
        properties = event_document(event, record.fleet, record.graph)
        if "x_m" in properties:
            features.append(_feature("Point", [properties.pop("x_m"), properties.pop("y_m")], {"layer": "event", **properties}))
    document = {
        "type": "FeatureCollection",
        "name": record.name,
        "crs_note": "local coordinates in metres, x right, y up",
        "features": features,
    }
    with replacing(path) as partial:
        partial.write_text(json.dumps(document, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")


def write_fcd(path: Path, record: RunRecord) -> None:
    """SUMO's floating car data (`--fcd-output`): x and y are the robot's centre, angle is clockwise from north in degrees."""
    execution = record.execution
    names = [quoteattr(name) for name in record.fleet.robot_name]
    with replacing(path) as partial, partial.open("w", encoding="utf-8") as out:
        out.write('<?xml version="1.0" encoding="UTF-8"?>\n<fcd-export>\n')
        for k, t in enumerate(execution.t_s.tolist()):
            out.write(f'    <timestep time="{t:.2f}">\n')
            there = np.flatnonzero(np.isfinite(execution.x_m[k]) & np.isfinite(execution.y_m[k]))
            angle = (90 - np.degrees(execution.yaw_rad[k, there])) % 360
            rows = zip(there.tolist(), *(a[k, there].tolist() for a in (execution.x_m, execution.y_m, execution.speed_mps)), angle.tolist())
            for r, x, y, speed, degrees in rows:
                out.write(
                    f'        <vehicle id={names[r]} x="{x:.4f}" y="{y:.4f}" angle="{degrees:.2f}" type="robot" speed="{speed:.4f}"/>\n'
                )
            out.write("    </timestep>\n")
        out.write("</fcd-export>\n")


def write_ros2(path: Path, make_bag: Callable[[Path], Any]) -> None:
    """A ROS 2 bag in a folder of this name, written by `make_bag` into one that is new; an interrupted writer leaves a hidden folder."""
    with replacing(path) as partial:
        (partial / "new").mkdir(parents=True)
        make_bag(partial / "new" / path.name)  # the files in it are named after the folder
        (partial / "new" / path.name).rename(partial.with_name(partial.name + "~"))
        shutil.rmtree(partial)
        partial.with_name(partial.name + "~").rename(partial)


def write_ros1(path: Path, record: RunRecord, make_bag: Callable[[Path], Any]) -> None:
    """A ROS 1 bag, `.bag`, of the ROS 2 bag that `make_bag` writes.

    RMF's topics keep their ROS 2 names; /rosout is left out, since its type is none of ROS 1.
    """
    from mrp_sumo.bags.convert import convert_to_ros1

    if path.suffix != ".bag":
        raise MrpSumoError(f"{path}: a ROS 1 bag of '{record.name}' needs a name that ends in .bag")
    with replacing(path) as partial, TemporaryDirectory(prefix="mrp_sumo_") as scratch:
        make_bag(Path(scratch) / "bag")
        convert_to_ros1(Path(scratch) / "bag", partial, NO_ROS1_TYPE)


def write_viewers(path: Path, record: RunRecord) -> None:
    """Set-ups for RViz 2, Foxglove, PlotJuggler and Rerun in a folder, showing this run's map."""
    xy = record.drawn.xy
    low, high = (xy.min(0), xy.max(0)) if len(xy) else (np.zeros(2), np.ones(2))
    centre, width, height = (low + high) / 2, float(high[0] - low[0]) + 2, float(high[1] - low[1]) + 2
    robot_m, pixels_per_m = float(record.fleet.width_m.max(initial=0.1)), min(1000 / width, 700 / height)
    figures = {
        "centre_x": f"{centre[0]:.2f}",
        "centre_y": f"{centre[1]:.2f}",
        "pixels_per_m": f"{pixels_per_m:.2f}",
        "distance_m": f"{1.3 * max(width * 0.7, height):.1f}",
        "robot_m": f"{robot_m:.3f}",
        "halo_m": f"{max(1.6 * robot_m, 6 / pixels_per_m):.3f}",  # so that the state's colour shows around the body, and from afar
        "num_robots": str(record.fleet.num_robots),
        "seconds": f"{float(record.execution.t_s[-1]):.1f}",
    }
    folder = resources.files("mrp_sumo") / "data" / "viewers"
    with replacing(path) as partial:
        partial.mkdir(parents=True)
        for file in sorted(folder.iterdir(), key=lambda f: f.name):
            if file.is_file():
                (partial / file.name).write_text(Template(file.read_text(encoding="utf-8")).substitute(figures), encoding="utf-8")


def _feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}
