"""The replay page: one HTML file that shows a run in any browser, without a network.

`replay_page` packs trajectory, plan, events and map as integers (positions to 5 mm, headings to 1.4 degrees, differences
in time, deflated, base64) beside the scripts of `replay/`, which draw them with PixiJS. Names are escaped so that no
HTML can begin in them, and the scripts set them as text only. Refuses run folders with nothing to show.
"""

import base64
import html
import json
import math
import re
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.bodies import Rectangles
from mrp_sumo.core.execution import RECORDED, Execution
from mrp_sumo.core.graph import FloatArray, IntArray, PlanGraph
from mrp_sumo.core.people import PeopleLog
from mrp_sumo.core.task import StopLog, TaskLog
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.files.writing import write_text
from mrp_sumo.io.outline import Outline
from mrp_sumo.io.record import RunRecord
from mrp_sumo.io.remedy import remedy
from mrp_sumo.io.run_reader import damage_in, load_run
from mrp_sumo.io.run_summary import orders_in_words, planner_of
from mrp_sumo.io.summary import lateness, seconds
from mrp_sumo.metrics.evaluate import succeeded
from mrp_sumo.plugins.source import short_name
from mrp_sumo.reports.pictures.view import (
    ABSENT,
    AnyRun,
    crossings,
    drawn_lanes,
    driven_backward,
    extent,
    forks_of,
    furniture_and_walls,
    is_grid_map,
    level_boxes,
    map_name_of,
    parts_of,
    state_names,
    subtitle_of,
    view_record,
    view_states,
)
from mrp_sumo.reports.replay.constants import NEVER, OFF_THE_FLOOR, constants_module, css_variables

SOURCES = Path(__file__).parent
LIVE = 'import "replay/live.js"; '
LIVE_SCRIPT = "live.js"  # the one that asks the network
LIBRARY = "pixi.min.js"
LONG, LONG_PARTS = "long", ("event_text", "tasks", "vertices")  # of the head, as JSON in a column: deflated they are a tenth
POSITION_M = 0.005
MAX_POSES = 9_000_000  # samples times robots; beyond it, every second, third, ... sample is kept
MAX_SIGHTINGS = 2_000_000  # of people, likewise
MAX_JUNCTIONS = 20_000
STATION_KINDS = (  # option of RMF, what people call it; the first that applies
    ("is_charger", "charger"),
    ("lift", "lift"),
    ("dock_name", "dock"),
    ("pickup_dispenser", "pick-up"),
    ("dropoff_ingestor", "drop-off"),
    ("is_parking_spot", "parking"),
    ("is_holding_point", "holding point"),
)


@dataclass(frozen=True)
class About:
    """The run in words, by names that the page's scripts know."""

    name: str
    subtitle: str = ""
    status_text: str = ""
    is_good: bool = True
    remedy: str = ""  # what would most likely mend it
    note: str = ""
    facts: tuple[tuple[str, str], ...] = ()
    metrics: tuple[tuple[str, str], ...] = ()
    outline: Outline | None = None
    plan_only: bool = False  # the record's execution is the plan itself


@dataclass
class Columns:
    """Integer columns on their way into the page; `data.js` reads them."""

    manifest: list[dict[str, Any]] = field(default_factory=list)
    parts: list[bytes] = field(default_factory=list)
    offset: int = 0

    def add(self, name: str, values: NDArray[Any], dtype: str, order: int = 0) -> None:
        """Add rows [rows, length] (or one row [length]) of unsigned integers, as differences of the given order along the row."""
        words = np.atleast_2d(values).astype(dtype, order="C")
        rows, length = words.shape
        size = words.dtype.itemsize
        for _ in range(order):
            words[:, 1:] -= words[:, :-1].copy()
        if order:
            signed = words.view(f"i{size}")
            words = ((signed << 1) ^ (signed >> (8 * size - 1))).view(dtype)
        planes = words.view(np.uint8).reshape(rows * length, size)
        self.parts += [planes[:, k].tobytes() for k in range(size)]
        self.manifest.append({"name": name, "offset": self.offset, "rows": rows, "length": length, "size": size, "order": order})
        self.offset += rows * length * size

    def packed(self) -> str:
        """All columns, deflated, as base64."""
        press = zlib.compressobj(6)
        return base64.b64encode(b"".join([*(press.compress(part) for part in self.parts), press.flush()])).decode()


def write_replay(folder: Path, out: Path | None = None) -> Path:
    """Write the replay page of a run, `replay.html` in its folder by default. Returns where it is.

    Raises MrpSumoError for a folder without a run, a run without a plan and a trajectory, and a page that cannot be written.
    """
    return write_page(page_of(load_run(folder)), out or folder / "replay.html")


def write_page(page: str, out: Path) -> Path:
    """Write a page, whole or not at all. Raises MrpSumoError where it cannot be written."""
    if out.is_dir():
        raise MrpSumoError(f"{out}: is a folder, expected a file such as {out / 'replay.html'}")
    write_text(out, page)
    return out


def page_of(run: AnyRun) -> str:
    """The page of a run. Raises MrpSumoError where its folder is damaged or there is nothing to replay."""
    return replay_page(*shown(run))


def shown(run: AnyRun) -> tuple[RunRecord, About]:
    """The log of a run and the words beside it. Raises MrpSumoError where its folder is damaged."""
    with damage_in(run.source):
        record = view_record(run)
        return record, about_run(run, record)


@dataclass(frozen=True)
class PageFrame:
    """Places on the floor as cells of a grid from the lower left."""

    low: FloatArray  # [2] m
    high: FloatArray  # [2] m

    @property
    def unit_m(self) -> float:
        return max(POSITION_M, float((self.high - self.low).max()) / 65000)

    def cells(self, values: FloatArray, axis: int | slice = slice(None)) -> NDArray[Any]:
        """Metres along an axis (or [..., 2]) as cells, 0 to 65535."""
        cells = np.rint((values - self.low[axis]) / self.unit_m)
        return np.clip(np.where(np.isfinite(cells), cells, 0), 0, 65535)


def replay_page(record: RunRecord, about: About, *, live_period_s: float | None = None) -> str:
    """The page of an executed run as text; for a plan alone see `plan_as_execution`. Raises MrpSumoError when there is nothing to show.

    For a run under way, the record has the first sample, and `live_period_s` is the time between those that the page will be sent.
    """
    execution = record.execution
    num_samples, num_robots = execution.x_m.shape
    if not num_samples or not num_robots:
        raise MrpSumoError(f"{about.name}: nothing to replay: {num_robots} robots, {num_samples} samples")
    frame = PageFrame(*extent(record, about.outline))
    low, high = frame.low, frame.high
    columns, parts = Columns(), parts_of(execution, record.fleet)
    head: dict[str, Any] = {name: value for name, value in vars(about).items() if name != "outline"} | {
        "state_names": (*state_names(execution.tasks is not None), OFF_THE_FLOOR),
        "robots": record.fleet.robot_name,
        "length": np.append(record.fleet.length_m, parts.length_m).round(4),
        "width": np.append(record.fleet.width_m, parts.width_m).round(4),
        "spacing_m": record.graph.cell_m,
        "goal_s": [None if math.isnan(t) else round(t, 3) for t in execution.goal_s.tolist()],
        "map": _map(record, about.outline, low, high),
    }
    head |= _add_motion(columns, execution, parts, frame)
    if (forks := forks_of(record.fleet)).any():
        head["forks"] = forks
    if execution.people is not None:
        head["people"] = _add_people(columns, execution.people, frame, head["num_samples"], len(execution.t_s))
    head["tasks"] = None if execution.tasks is None else task_document(execution.tasks, execution.stops)
    used = _add_plan(columns, record, low, high, names_all=live_period_s is not None)
    index = used.pop("vertex_index")
    head |= used | _add_events(columns, record, index)
    if live_period_s is not None:
        head |= {"live": True, "period_s": round(live_period_s, 9)}
    columns.add(LONG, np.frombuffer(_json({name: head.pop(name) for name in LONG_PARTS}).encode("utf-8", "replace"), np.uint8), "<u1")
    head["manifest"] = columns.manifest
    return filled(
        SOURCES / "page.html",
        title=html.escape(f"{about.name} – replay"),
        style=filled(SOURCES / "page.css", light=css_variables("light"), dark=css_variables("dark")),
        head=_script_json(head),
        data=columns.packed(),
        library=base64.b64encode(zlib.compress((SOURCES / LIBRARY).read_bytes(), 9)).decode(),
        modules=_import_map(is_live=live_period_s is not None),
        begin=f'{"" if live_period_s is None else LIVE}import "replay/main.js";',
    )


def about_run(run: AnyRun, record: RunRecord) -> About:
    """A run in words, from its result."""
    scenario, metrics = run.result["scenario"], run.metrics

    def worded(name: str, words: str) -> str | None:
        return None if metrics.get(name) is None else words.format(metrics[name])

    status = run.result["status"].replace("_", " ")
    is_planned = run.result.get("policy") != RECORDED
    num_robots = record.fleet.num_robots
    facts: dict[str, Any] = {
        "Status": status,
        "Map": map_name_of(run.result),
        "Robots": f"{num_robots}",
        "Planner": planner_of(run.result) if is_planned else None,
        "Assignment": scenario["assignment"]["mode"] if is_planned else None,
        "Policy": short_name(run.result.get("policy") or "") or None,
        "Seed": run.result["seed"] if is_planned else None,
        "Orders": orders_in_words(metrics),
        "Throughput": worded("throughput_per_h", "{:.0f} an hour"),
        "Lead time": seconds(metrics.get("lead_time_mean_s")),
        "People": worded("num_people", "{}"),
        "Goals reached": worded("goals_reached", f"{{}} of {num_robots}"),
        "Planned makespan": seconds(metrics.get("makespan_s")) if is_planned else None,
        "Driven makespan": seconds(metrics.get("driven_makespan_s")),
    }
    bound, in_steps = metrics.get("lower_bound_steps"), metrics.get("soc_steps") is not None  # plans in seconds have no such bound
    numbers = {
        "Planning time": seconds(metrics.get("planning_time_s")) if is_planned else None,
        "Planning time, CPU": seconds(metrics.get("planning_cpu_s")) if is_planned else None,
        "Sum of costs": worded("soc_steps", "{:.0f} steps"),
        "Lower bound": f"{bound:.0f} steps" if bound and in_steps else None,
        "Blocked in all": seconds(metrics.get("blocked_s")),
        "Mean lateness": lateness(metrics.get("lateness_mean_s")),
        "Largest lateness": lateness(metrics.get("lateness_max_s")),
        "Least clearance": worded("min_clearance_m", "{:.3f} m"),
        "Overlaps": metrics.get("num_overlaps"),
        "Wall contacts": metrics.get("num_wall_contacts"),
        "Lost to people": seconds(metrics.get("lost_to_people_s")),
        "Protective stops": worded("protective_stops_per_robot_h", "{:.1f} per robot and hour"),
        "Least distance to a person": worded("min_person_distance_m", "{:.3f} m"),
    }
    return About(
        name=record.name,
        subtitle=subtitle_of(run.result, num_robots),
        status_text=status if run.executed else f"{status}, plan only",
        is_good=succeeded(run.result["status"], metrics),
        remedy=remedy(run.result),
        note=run.result.get("note") or ("" if run.executed else "The run was not executed: this is the plan, driven exactly."),
        facts=tuple((name, str(value)) for name, value in facts.items() if value not in (None, "")),
        metrics=tuple((name, str(value)) for name, value in numbers.items() if value not in (None, "")),
        outline=run.outline,
        plan_only=not run.executed,
    )


def _add_motion(columns: Columns, execution: Execution, parts: Rectangles, frame: PageFrame) -> dict[str, Any]:
    """Poses and states, robot by robot, and part by part, in the state of its robot where it is there."""
    stride = math.ceil(execution.x_m.size / MAX_POSES)
    shown = slice(None, None, stride)
    state = view_states(execution)[shown]
    state = np.hstack([state, np.where(np.isnan(parts.x_m[shown]), ABSENT, state[:, parts.owner])])
    x, y, yaw = (np.hstack([getattr(execution, name)[shown], getattr(parts, name)[shown]]).T for name in ("x_m", "y_m", "yaw_rad"))
    columns.add("x", frame.cells(x, 0), "<u2", 2)
    columns.add("y", frame.cells(y, 1), "<u2", 2)
    columns.add("yaw", np.rint(np.nan_to_num(yaw) * (128 / np.pi)).astype(np.int64) % 256, "<u1", 1)
    columns.add("state", state.T, "<u1", 1)
    t_s = execution.t_s[shown]
    period_s = float(t_s[-1] - t_s[0]) / (len(t_s) - 1) if len(t_s) > 1 else 0.1
    towed = {"owner": parts.owner, "bar": parts.bar_m.round(4)} if len(parts.owner) else {}
    return {"num_samples": len(t_s), "period_s": round(period_s, 9), "unit_m": frame.unit_m, **towed}


def _add_people(columns: Columns, log: PeopleLog, frame: PageFrame, num_kept: int, num_samples: int) -> dict[str, Any]:
    stride = math.ceil(num_samples / max(1, num_kept))
    every = math.ceil(len(log.person) / stride / MAX_SIGHTINGS) or 1
    sample = np.repeat(np.arange(num_samples), np.diff(log.first))
    shown = np.flatnonzero(sample % (stride * every) == 0)
    shown = shown[np.lexsort((sample[shown], log.person[shown]))]
    _, begin, count = np.unique(log.person[shown], return_index=True, return_counts=True)
    columns.add("people_x", frame.cells(log.x_m[shown].astype(np.float64), 0), "<u2", 2)
    columns.add("people_y", frame.cells(log.y_m[shown].astype(np.float64), 1), "<u2", 2)
    columns.add("people_since", sample[shown][begin] // (stride * every), "<u4", 1)
    columns.add("people_count", count, "<u4", 1)
    return {"every": every, "size_m": 2 * log.radius_m}


def _add_plan(columns: Columns, record: RunRecord, low: FloatArray, high: FloatArray, *, names_all: bool) -> dict[str, Any]:
    """Planned visits and when they were reached; the vertices that plan, goals and events name, or all, renumbered."""
    plan, graph = record.plan, record.graph
    named = [record.target, np.array([e.vertex for e in record.execution.events], np.int64)]
    if plan is not None:
        named.append(plan.vertex)
    vertices = np.unique(np.concatenate(named))
    vertices = np.arange(graph.num_vertices) if names_all else vertices[(vertices >= 0) & (vertices < graph.num_vertices)]
    index = np.full(graph.num_vertices + 1, -1)
    index[vertices] = np.arange(len(vertices))
    unit_m = max(0.001, float((high - low).max()) / 1e6)
    xy, bends = np.rint((graph.xy[vertices] - low) / unit_m), {}
    columns.add("vertex_x", xy[:, 0], "<u4", 1)
    columns.add("vertex_y", xy[:, 1], "<u4", 1)
    if plan is not None:
        columns.add("plan_first", plan.first, "<u4", 1)
        columns.add("plan_vertex", index[plan.vertex], "<u4", 1)
        columns.add("plan_arrive", _milliseconds(plan.arrive_s), "<u4", 1)
        columns.add("plan_depart", _milliseconds(plan.depart_s), "<u4", 1)
        backward = driven_backward(plan, graph, record.fleet, record.execution.yaw_rad[0])
        if backward.any():
            columns.add("plan_backward", backward, "<u1")
        columns.add("plan_arrived", _milliseconds(record.execution.arrived_s), "<u4", 1)
        bends = {  # by the vertices at the ends: share of the lane, x, y, course
            f"{index[tail]},{index[head]}": np.column_stack([places[:, 0] / places[-1, 0], places[:, 1:3] - low, places[:, 3]]).round(4)
            for (tail, head), places in graph.curves.items()
            if min(index[tail], index[head]) >= 0
        }
    return {
        "vertex_unit_m": unit_m,
        "vertices": [graph.known_as(int(v)) for v in vertices],
        "bends": bends,
        "target": index[record.target] if len(record.target) else [],
        "vertex_index": index,
    }


def task_document(log: TaskLog, stops: StopLog | None) -> dict[str, Any]:
    """The tasks that are known, and by station when robots waited there, were served and left."""

    def rounded(times: FloatArray) -> list[float | None]:
        return [round(t, 2) if math.isfinite(t) else None for t in times.tolist()]

    times = zip(*(rounded(column) for column in (log.released_s, log.assigned_s, log.opened_s, log.done_s)))
    at: dict[str, list[tuple[float, ...]]] = {}
    if stops is not None:
        for name, begin_s, queued_s, end_s in zip(stops.station, stops.begin_s, stops.queued_s, stops.end_s):
            at.setdefault(name, []).append((round(begin_s - queued_s, 2), round(begin_s, 2), round(end_s, 2)))
    busiest = sorted(at.items(), key=lambda item: (-len(item[1]), item[0]))
    return {"name": log.name, "robot": log.robot.tolist(), "times": list(times), "stations": busiest}


def _add_events(columns: Columns, record: RunRecord, index: IntArray) -> dict[str, Any]:
    events = sorted(record.execution.events, key=lambda event: event.t_s)
    kinds = list(dict.fromkeys(event.kind for event in events))
    if events:
        columns.add("event_t", _milliseconds(np.array([e.t_s for e in events])), "<u4", 1)
        left_s = float(record.execution.t_s[-1]) - np.array([e.t_s for e in events])  # what lasts for good is shown to the end
        lasts_s = np.array([e.duration_s for e in events])
        columns.add("event_duration", _milliseconds(np.where(np.isinf(lasts_s), left_s, lasts_s)), "<u4")
        columns.add("event_kind", np.array([kinds.index(e.kind) for e in events]) % 256, "<u1")
        for name, numbers in zip(("robot", "other", "vertex"), np.array([(e.robot, e.other, index[e.vertex]) for e in events]).T):
            columns.add(f"event_{name}", numbers % 2**32, "<u4")
    return {"event_kinds": kinds, "event_text": {i: e.text for i, e in enumerate(events) if e.text}}


def _milliseconds(t_s: FloatArray) -> NDArray[Any]:
    """Whole milliseconds; NEVER where it is not finite."""
    with np.errstate(invalid="ignore"):
        ms = np.rint(t_s * 1000)
    return np.where(np.isfinite(ms), np.clip(np.nan_to_num(ms, posinf=0), 0, NEVER - 1), NEVER)


def _map(record: RunRecord, outline: Outline | None, low: FloatArray, high: FloatArray) -> dict[str, Any]:
    """What is drawn under the robots, in m from the lower left corner."""
    nav = record.drawn
    parts: dict[str, Any] = {"size_m": high - low, "floors": [], "holes": [], "cells": [], "furniture": [], "inner": []}
    parts |= {"lifts": [], "walls": [], "doors": [], "lanes": [], "stations": [], "junctions": []}
    if outline is not None:
        furniture, inner, walls = furniture_and_walls(outline.walls)
        of_kind = {"floors": outline.floors, "holes": outline.holes, "lifts": outline.lifts, "furniture": furniture, "doors": outline.doors}
        parts |= {kind: [_flat(p - low) for p in polygons] for kind, polygons in of_kind.items()}
        parts |= {"inner": _flat(inner - low), "walls": _flat(walls - low)}
    if is_grid_map(record):
        parts["cells"] = [_flat(np.array(c) - (*low, 0, 0)) for c in _rows_of_cells(record.graph)]
    else:
        once = drawn_lanes(nav)
        ends = np.column_stack((nav.xy[nav.tail[once]] - low, nav.xy[nav.head[once]] - low, nav.reverse[once] < 0))
        parts["lanes"] = _flat(ends)
        kind = [next((name for option, name in STATION_KINDS if options.get(option)), "") for options in nav.vertex_options]
        xy = (nav.xy - low).round(3).tolist()
        crossing = crossings(nav)
        parts["stations"] = [
            {"name": nav.known_as(v) if name or "station" in nav.vertex_options[v] else "", "kind": kind[v], "x": xy[v][0], "y": xy[v][1]}
            | ({"crossing": True} if crossing[v] and not kind[v] else {})
            for v, name in enumerate(nav.vertex_name)
            if name or kind[v]
        ]
        bare = np.array([not (nav.vertex_name[v] or kind[v]) for v in range(nav.num_vertices)], np.bool_)
        bare[np.setdiff1d(np.arange(nav.num_vertices), np.concatenate([nav.tail, nav.head]))] = False
        parts["junctions"] = _flat(nav.xy[bare][:MAX_JUNCTIONS] - low)
    boxes = level_boxes(record, outline)
    parts["levels"] = [  # each with its upper left corner
        dict(zip(("name", "x", "y", "width", "height"), (name, *np.round([a[0] - low[0], b[1] - low[1], *(b - a)], 3).tolist())))
        for name, (a, b) in (boxes.items() if len(boxes) > 1 else ())
    ]
    return parts


def _rows_of_cells(grid: PlanGraph) -> list[tuple[float, float, float, float]]:
    """The free cells of a grid as (x, y, width, height), neighbours in a row joined."""
    cell = np.rint((grid.xy - grid.xy.min(axis=0)) / grid.cell_m).astype(np.int64)
    order = np.lexsort(cell.T)
    column, row = cell[order].T
    begin = np.flatnonzero(np.concatenate(([True], (np.diff(row) != 0) | (np.diff(column) != 1))))
    length = np.diff(np.append(begin, len(order)))
    corner = grid.xy[order[begin]] - grid.cell_m / 2
    return [(x, y, n * grid.cell_m, grid.cell_m) for (x, y), n in zip(corner.tolist(), length.tolist())]


def _flat(values: NDArray[Any]) -> list[float]:
    return np.asarray(values, np.float64).round(3).ravel().tolist()


def _script_json(value: Any) -> str:
    """JSON in which no tag can begin or end."""
    text = _json(value).translate({ord(character): f"\\u{ord(character):04x}" for character in "<>&\u2028\u2029"})
    return text.encode("utf-8", "replace").decode("utf-8")


def _json(value: Any) -> str:
    def plain(item: Any) -> Any:
        if isinstance(item, np.ndarray | np.generic):
            return item.tolist()
        raise TypeError(type(item))

    return json.dumps(value, default=plain, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def _import_map(*, is_live: bool) -> str:
    """All scripts as an import map of `data:` addresses, which a page of one file can load without a server.

    In their files the modules import each other as `./scene.js`; an address like that leads nowhere from within
    a `data:` address, so it becomes the name `replay/scene.js`, which the map resolves.
    """
    scripts = sorted({path.name for path in SOURCES.glob("*.js")} - {LIBRARY, LIVE_SCRIPT}) + [LIVE_SCRIPT] * is_live
    code = {"constants.js": constants_module()} | {name: (SOURCES / name).read_text(encoding="utf-8") for name in scripts}
    places = {}
    for name, text in code.items():
        text = re.sub(r'(?<= from ")\./(?=\w+\.js";$)', "replay/", text, flags=re.MULTILINE)
        places[f"replay/{name}"] = f"data:text/javascript;base64,{base64.b64encode(text.encode()).decode()}"
    return json.dumps({"imports": places})


def filled(path: Path, **parts: str) -> str:
    """A file with its `{{places}}` filled; a part may contain what looks like a place."""
    text = path.read_text(encoding="utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda place: parts[place[1]], text)
