"""A run over time as videos show it: where robots are at any moment, what is planned for them next, and whom they wait for."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.bodies import Rectangles
from mrp_sumo.core.execution import positions_at
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray
from mrp_sumo.core.plan import Plan
from mrp_sumo.errors import MrpSumoError, nearest
from mrp_sumo.io.outline import Outline
from mrp_sumo.io.record import BLOCKED, WAITING, RunRecord
from mrp_sumo.io.run_reader import damage_in
from mrp_sumo.reports.pictures.view import (
    ABSENT,
    MARGIN_M,
    AnyRun,
    extent,
    forks_of,
    level_boxes,
    parts_at,
    parts_of,
    subtitle_of,
    view_record,
    view_states,
)

AHEAD_S = 10.0  # of the plan

Visits = tuple[IntArray, FloatArray, FloatArray]  # vertices, times as planned, times as driven


@dataclass(frozen=True, eq=False)
class PlannedRoute:
    """Visits of a robot from a time on, until it was sent elsewhere: N visits."""

    since_s: float
    vertex: IntArray  # [N]
    arrive_s: FloatArray  # [N] as planned
    arrived_s: FloatArray  # [N] as driven, inf: never

    def ahead(self, t_s: float) -> range:
        """Visits with which the plan goes on within `AHEAD_S` from a time."""
        k = int(np.searchsorted(self.arrived_s, t_s, side="right"))
        if k == len(self.vertex):
            return range(0)
        return range(k, max(k + 1, int(np.searchsorted(self.arrive_s, self.arrive_s[k] + AHEAD_S, side="right"))))


@dataclass(frozen=True, eq=False)
class SceneState:
    """R robots and N parts of them at a time."""

    t_s: float
    xy: FloatArray  # [R, 2] m
    yaw_rad: FloatArray  # [R]
    state: NDArray[np.int8]  # [R]
    parts_xy: FloatArray  # [N, 2] m, NaN where one is not there
    parts_yaw_rad: FloatArray  # [N]


@dataclass(frozen=True, eq=False)
class Scene:
    """A run of R robots."""

    title: str
    subtitle: str
    record: RunRecord
    outline: Outline | None
    low: FloatArray  # [2] lower left of what is shown, m
    high: FloatArray  # [2]
    state: NDArray[np.int8]  # [T, R]
    parts: Rectangles  # N trailers and loads
    forks: IntArray  # [R] 1: in front, -1: behind, 0: none
    ways: tuple[tuple[PlannedRoute, ...], ...]  # by robot, by time
    waits: tuple[tuple[tuple[float, float, int], ...], ...]  # by robot: from, until, and for whom
    name: tuple[str, ...]  # [R] as written beside robots
    chosen: BoolArray  # [R] whom the viewer asked for
    has_choice: bool

    @property
    def end_s(self) -> float:
        return float(self.record.execution.t_s[-1])

    def moments(self, t_s: FloatArray) -> list[SceneState]:
        """The run at ascending times; after its end as at its end."""
        execution = self.record.execution
        x, y, yaw = positions_at(execution, t_s)
        parts_xy, parts_yaw = parts_at(self.parts, execution, t_s)
        sample = np.clip(np.searchsorted(execution.t_s, t_s + 1e-9) - 1, 0, len(execution.t_s) - 1)
        state = self.state[sample].copy()
        state[~(np.isfinite(x) & np.isfinite(y))] = ABSENT
        return [SceneState(float(t), np.column_stack((x[k], y[k])), yaw[k], state[k], parts_xy[k], parts_yaw[k]) for k, t in enumerate(t_s)]

    def ahead(self, robot: int, now: SceneState) -> FloatArray:
        """[K, 2] where a robot's plan goes on from where it is, along curves where lanes are drawn as such."""
        path, graph = next((path for path in reversed(self.ways[robot]) if path.since_s <= now.t_s), None), self.record.graph
        lines = [np.zeros((0, 2))]
        if path is None:
            return lines[0]
        for k in path.ahead(now.t_s):
            tail, head = path.vertex[max(k - 1, 0)], path.vertex[k]
            curve = graph.curves.get((int(tail), int(head)))
            line = graph.xy[[head]] if curve is None else curve[:, 1:3]
            if len(lines) == 1:  # it is somewhere on this lane
                line = line[np.hypot(*(line - now.xy[robot]).T).argmin() :]
            lines.append(line)
        return np.concatenate(lines)

    def waited_for(self, state: SceneState) -> list[tuple[int, int]]:
        """Pairs of a robot that waits and the one it waits for."""
        pairs = []
        for robot in np.flatnonzero((state.state == WAITING) | (state.state == BLOCKED)).tolist():
            others = [other for a, b, other in self.waits[robot] if a <= state.t_s + 1e-6 and b >= state.t_s]
            if others:
                pairs.append((robot, others[-1]))
        return pairs

    def tasks_at(self, t_s: float) -> tuple[int, int] | None:
        """Numbers of tasks done and open; None in runs without tasks."""
        tasks = self.record.execution.tasks
        if tasks is None:
            return None
        orders = tasks.is_order
        done = int((tasks.done_s[orders] <= t_s).sum())
        return done, int((tasks.released_s[orders] <= t_s).sum()) - done


def scene_of(run: AnyRun, *, robots: Sequence[str] = (), level: str | None = None) -> Scene:
    """A run, to be shown as a video.

    Raises MrpSumoError for a run with nothing to show, damaged files, and names of robots or levels that there are not.
    """
    with damage_in(run.source):
        record, outline, plan = view_record(run), run.outline, run.plan
    execution, names = record.execution, record.fleet.robot_name
    if not execution.x_m.size:
        raise MrpSumoError(f"{run.source}: nothing to show: {execution.num_robots} robots, {len(execution.t_s)} samples")
    for name in robots:
        if name not in names:
            raise MrpSumoError(f"--robots {name}: {run.source} has no such robot{nearest(name, names)}")
    low, high = extent(record, outline)
    if level is not None:
        low, high = _extent_of_level(record, outline, level, run.source)
    policy = run.result.get("policy") or ""
    words = (subtitle_of(run.result, record.fleet.num_robots), policy if run.executed else "plan, not driven")
    return Scene(
        title=record.name,
        subtitle=" · ".join(filter(None, words)),
        record=record,
        outline=outline,
        low=low,
        high=high,
        state=view_states(execution),
        parts=parts_of(execution, record.fleet),
        forks=forks_of(record.fleet),
        ways=_ways(record, plan),
        waits=_waits(record),
        name=_short_names(names),
        chosen=np.isin(np.array(names), list(robots)),
        has_choice=bool(robots),
    )


def _extent_of_level(record: RunRecord, outline: Outline | None, level: str, source: str) -> tuple[FloatArray, FloatArray]:
    """The part of the floor that a level takes."""
    names = record.drawn.level_names
    if level not in names:
        raise MrpSumoError(f"--level {level}: {source} has no such level{nearest(level, names)}")
    boxes = level_boxes(record, outline)
    if level not in boxes:
        raise MrpSumoError(f"--level {level}: no robot can drive there")
    low, high = boxes[level]
    return low - MARGIN_M, high + MARGIN_M


def _ways(record: RunRecord, plan: Plan | None) -> tuple[tuple[PlannedRoute, ...], ...]:
    """What each robot was to do, by time: the plan, and what came instead while it drove."""
    num_robots, execution = record.fleet.num_robots, record.execution
    if plan is None or len(execution.arrived_s) != len(plan.vertex):
        return tuple(() for _ in range(num_robots))
    columns: list[Visits] = [(plan.vertex[a:b], plan.arrive_s[a:b], execution.arrived_s[a:b]) for a, b in pairwise(plan.first.tolist())]
    paths = [[_way(0.0, visits)] for visits in columns]
    begin = [0] * num_robots  # number of each robot's first visit that is still kept
    for reply in execution.replies:
        for k, robot in enumerate(reply.robot.tolist()):
            new = slice(int(reply.first[k]), int(reply.first[k + 1]))
            old = tuple(column[: int(reply.since[k]) + 1 - begin[robot]] for column in columns[robot])
            done = max(0, int((old[2] < reply.t_s).sum()) - 1)
            begin[robot] += done
            parts = zip((column[done:] for column in old), (reply.vertex[new], reply.arrive_s[new], reply.arrived_s[new]))
            columns[robot] = tuple(np.concatenate(part) for part in parts)  # type: ignore[assignment]
            paths[robot].append(_way(reply.t_s, columns[robot]))
    return tuple(map(tuple, paths))


def _way(since_s: float, visits: Visits) -> PlannedRoute:
    vertex, arrive_s, arrived_s = visits
    reached = np.where(np.isfinite(arrived_s), arrived_s, np.inf)
    return PlannedRoute(since_s, vertex, arrive_s, np.maximum.accumulate(reached))


def _waits(record: RunRecord) -> tuple[tuple[tuple[float, float, int], ...], ...]:
    num_robots = record.fleet.num_robots
    waits: list[list[tuple[float, float, int]]] = [[] for _ in range(num_robots)]
    for event in record.execution.events:
        if event.duration_s > 0 and 0 <= event.robot < num_robots and 0 <= event.other < num_robots:
            waits[event.robot].append((event.t_s, event.t_s + event.duration_s, event.other))
    return tuple(tuple(sorted(of)) for of in waits)


def _short_names(names: Sequence[str]) -> tuple[str, ...]:
    """Names without what all begin with, where numbers are left: robot_12 is written 12."""
    stems = {name.rstrip("0123456789") for name in names}
    if len(stems) == 1 and all(name != stem for stem in stems for name in names):
        return tuple(name[len(next(iter(stems))) :] for name in names)
    return tuple(names)
