"""An independent look at what was driven: did robots overlap, touch walls, jump, speed, turn or brake harder than they can.

Knows the trajectory, the robots' footprints and limits, with loads and without, the walls, and where SUMO says it had the robots;
nothing of plans and policies, so it can disagree with all of them. Between samples it takes robots to move straight and evenly, and looks
at all of that way, not only at the samples.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.bodies import axle_of, bodies_of
from mrp_sumo.core.execution import Execution, Outcome, positions_at
from mrp_sumo.core.facilities import CABIN_M, beyond_cabin_m
from mrp_sumo.core.fleet import LIMITS, Fleet, fleet_of
from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.maps.boxes import overlapping
from mrp_sumo.metrics import _audit, _people, _walls
from mrp_sumo.metrics.metric import TOGETHER
from mrp_sumo.metrics.operations.evidence import Finding

LISTED = 20  # findings of a kind that are listed one by one
ELSEWHERE_M = 0.02  # SUMO rounds shapes and lengths
PLACE_M = 1.0  # side of the squares for which walls are listed
MOST_PLACES = 2000  # along either side of the floor
FAR_M = 1e6  # between levels
POSE = ("x_m", "y_m", "yaw_rad", "speed_mps")
LOOK_M = 1.0  # how far walls are looked for at first
KINDS = {  # of violations: the count they go to, in the order of the kernel's numbers
    "speed": "num_speed_violations",
    "accel": "num_accel_violations",
    "decel": "num_decel_violations",
    "turn_rate": "num_turn_rate_violations",
    "jump": "num_jumps",
    "heading_jump": "num_heading_jumps",
}
WHEEL_SLACK, WHEEL_SLACK_M = 0.02, 2e-3  # in which robots stop short of vertices and lanes are rounded
IN_WORDS = (  # kinds of findings: where they are listed, what counts them, the words between robot and place
    ("overlaps", ("num_overlaps",), "overlap"),
    ("wall_contacts", ("num_wall_contacts",), "{at_wall}"),
    ("person_contacts", ("num_person_contacts",), "drives into person {person}"),
    ("field_violations", ("num_field_violations",), "drives {speed_mps:.2f} m/s, faster than its protective field allows,"),
    ("rides_outside", ("num_rides_outside",), "rides a lift outside its cabin"),
    ("violations", (*KINDS.values(), "num_wheel_violations"), "breaks its limit of {kind}: {value:.3g} where {limit:.3g} is the most,"),
    ("sumo_disagreements", ("num_sumo_disagreements",), "is {apart_m:.3f} m from where SUMO has it"),
)


def audit(
    execution: Execution, fleet: Fleet, level: IntArray | None = None, walls: FloatArray | None = None, cabins: FloatArray | None = None
) -> dict[str, Any]:
    """Look over an execution: T samples of R robots, whose footprints are rectangles turned by the yaw around the centre.

    `level` [R] is the floor each robot is on, by default one for all; robots on different floors never meet. Where the execution knows the
    levels of its robots, these lie beside each other, and robots in lifts are on none while they change. `walls` [W, 2, 2] m are those of
    all these floors, without those that doors open; `cabins` [C, 6] those of lifts: level, x and y of the centre in m, yaw in rad, width
    and depth in m; None where nobody knows.

    Returns `passed`, and counts, least distances and first findings by the keys of docs/metrics.md, section Audit.
    """
    rides = _outside_cabins(execution, fleet, cabins)
    if execution.level is not None:
        execution, level = _on_floors(execution, execution.level), None
    spread, trains, level = _with_trailers(execution, fleet, level)
    parts, members, floors = _by_load(spread, trains, level, fleet)
    overlaps, clearance = _closeness(_apart(parts), members, floors)
    walls_found = _at_walls(parts, members, walls)
    people_found = _among_people(parts, members, range(fleet.num_robots, trains.num_robots))
    counts, violations = _motion(*_by_load(execution, fleet, None, fleet)[:2])
    wheels = _wheels(execution, fleet)
    counts |= {"num_wheel_violations": len(wheels)} if fleet.vehicle_of_kind else {}
    violations += wheels[:LISTED]
    elsewhere, apart_m = _elsewhere(execution, fleet)
    collisions = execution.findings
    return {
        "passed": not (overlaps or walls_found["num_wall_contacts"] or any(counts.values()) or elsewhere or collisions)
        and not (people_found["num_person_contacts"] or people_found["num_field_violations"] or rides),
        "num_overlaps": len(overlaps),
        "overlaps": overlaps[:LISTED],
        "min_clearance_m": clearance["m"] if clearance else None,
        "min_clearance": clearance and {key: clearance[key] for key in ("robots", "t_s")},
        **walls_found,
        **people_found,
        "num_rides_outside": None if rides is None else len(rides),
        "rides_outside": None if rides is None else rides[:LISTED],
        **counts,
        "violations": violations,
        "num_sumo_disagreements": len(elsewhere),
        "sumo_disagreements": elsewhere[:LISTED],
        "sumo_apart_m": apart_m,
        "num_sumo_collisions": len(collisions),
        "sumo_collisions": list(collisions[:LISTED]),
    }


def first_findings(audited: dict[str, Any]) -> Iterator[Finding]:
    """Findings of an audit, the first of each kind, with how many more there are."""
    for listed, counts, words in IN_WORDS:
        if count := sum(audited.get(name) or 0 for name in counts):
            first = audited[listed][0]
            robots = first.get("robots") or [first["robot"]]
            place = f" at ({first['x_m']:.2f}, {first['y_m']:.2f})" if "x_m" in first else ""
            at_wall = "drives through a wall" if first.get("crosses") else "touches a wall"
            more = f", and {count - 1} more" if count > 1 else ""
            text = f"{' and '.join(robots)} {words.format(**first, at_wall=at_wall)}{place} after {first['t_s']:.1f} s{more}"
            yield Finding("bodies", first["t_s"], text, robot=robots[0])
    for text in audited["sumo_collisions"][:1]:
        yield Finding("bodies", 0.0, text)


def in_words(audited: dict[str, Any]) -> str:
    """The first finding of each kind; '' for none."""
    return "; ".join(finding.text for finding in first_findings(audited))


def prepare() -> None:
    """Get the kernels compiled or loaded: two robots that stand still."""
    x, still = np.array([[0.0, 2.0]] * 2), np.zeros((2, 2))
    run = Execution(np.arange(2.0), x, still, still, still, np.zeros(0), np.zeros(2), Outcome.COMPLETED, "", 1.0, 0.0, 0.0)
    audit(run, fleet_of(RobotType("dot", 0.1, 0.1, 1.0, 1.0, 1.0, 1.0), 2), walls=np.array([[(0.0, 1.0), (1.0, 1.0)]]))


def _by_load(execution: Execution, members: Fleet, level: IntArray | None, fleet: Fleet) -> tuple[Execution, Fleet, IntArray | None]:
    """The execution with each robot that is another with a load as two parts, of which one is there at a time.

    Robots stand while that changes: both are there at the sample of a change. The first of the members are the robots themselves.
    """
    loads, loaded = execution.loads, fleet.loaded
    if loads is None or loaded is None:
        return execution, members, level
    num_parts, other = members.num_robots, np.flatnonzero(np.any([getattr(loaded, key) != getattr(fleet, key) for key in LIMITS], axis=0))
    with_load, changes = loads[:, other] > 0, np.zeros((len(loads), len(other)), np.bool_)
    changes[1:] = with_load[1:] != with_load[:-1]
    part, absent = np.append(np.arange(num_parts), other), np.zeros((len(loads), num_parts + len(other)), np.bool_)
    absent[:, other], absent[:, num_parts:] = with_load & ~changes, ~(with_load | changes)
    columns: dict[str, Any] = {key: np.where(absent, np.nan, getattr(execution, key)[:, part]) for key in POSE}
    limits: dict[str, Any] = {key: np.append(getattr(members, key), getattr(loaded, key)[other]) for key in (*LIMITS, "kind")}
    owner = members.owner if isinstance(members, Parts) else np.arange(num_parts)
    names = tuple(members.robot_name[k] for k in part.tolist())
    floor = None if execution.level is None else execution.level[:, part]
    parts = Parts(robot_name=names, apart_m=fleet.apart_m, types=fleet.types, owner=np.append(owner, other), **limits)
    return replace(execution, **columns, level=floor, hitch_rad={}), parts, None if level is None else level[part]


def _poses(execution: Execution) -> _audit.Poses:
    return _audit.Poses(_rows(execution.x_m), _rows(execution.y_m), _rows(execution.yaw_rad))


@dataclass(frozen=True, eq=False)
class Parts(Fleet):
    """Robots and trailers, each as a robot of its own."""

    owner: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))  # [B]


def _with_trailers(execution: Execution, fleet: Fleet, level: IntArray | None) -> tuple[Execution, Fleet, IntArray | None]:
    if not execution.hitch_rad:
        return execution, fleet, level
    bodies = bodies_of(execution, fleet)
    owner = bodies.owner
    columns = {key: getattr(fleet, key)[owner] for key in (*LIMITS, "kind")} | {"length_m": bodies.length_m, "width_m": bodies.width_m}
    parts = Parts(robot_name=bodies.name, apart_m=fleet.apart_m, owner=owner, **columns)
    floor = None if execution.level is None else execution.level[:, owner]
    speed = execution.speed_mps[:, owner]
    spread = replace(execution, x_m=bodies.x_m, y_m=bodies.y_m, yaw_rad=bodies.yaw_rad, speed_mps=speed, level=floor, hitch_rad={})
    return spread, parts, None if level is None else level[owner]


def _wheels(execution: Execution, fleet: Fleet) -> list[dict[str, Any]]:
    """Moves between two samples that the wheels of a vehicle cannot make: a turn too tight, a slip to the side, driving backwards."""
    wrong = []
    for r, k in enumerate(fleet.kind.tolist() if fleet.vehicle_of_kind else ()):
        vehicle = fleet.types[k]
        if not vehicle.is_vehicle:
            continue
        yaw = np.unwrap(execution.yaw_rad[:, r])
        x, y = axle_of(execution.x_m[:, r], execution.y_m[:, r], yaw, vehicle.kinematics.ahead_m)
        along, turned, middle = np.stack([np.diff(x), np.diff(y)]), np.abs(np.diff(yaw)), (yaw[1:] + yaw[:-1]) / 2
        ahead, aside = along[0] * np.cos(middle) + along[1] * np.sin(middle), along[1] * np.cos(middle) - along[0] * np.sin(middle)
        moved, least_m = np.hypot(*along), vehicle.kinematics.least_radius_m
        chord_m = 2 * least_m * np.sin(np.minimum(turned, np.pi) / 2)  # of the tightest arc
        speed_mps = moved / np.diff(execution.t_s)
        radius_m = np.maximum(least_m, speed_mps**2 / vehicle.kinematics.lateral_mps2)  # of two bends, one to each side, between samples
        aside_m = np.maximum(moved * turned / 2, moved**2 / (4 * radius_m))
        checks = (
            ("radius", chord_m > moved * (1 + WHEEL_SLACK) + WHEEL_SLACK_M, moved / np.maximum(turned, 1e-12), least_m),
            ("side slip", np.abs(aside) > aside_m + WHEEL_SLACK_M, np.abs(aside), 0.0),
            ("reverse", (ahead < -WHEEL_SLACK_M) & (not vehicle.kinematics.reverse), -ahead, 0.0),
        )
        for kind, is_wrong, value, limit in checks:
            for at in np.flatnonzero(is_wrong).tolist():
                t_s = float(execution.t_s[at + 1])
                wrong.append({"kind": kind, "robot": fleet.robot_name[r], "t_s": t_s, "value": float(value[at]), "limit": limit})
    return wrong


def _bodies(fleet: Fleet) -> _audit.Footprints:
    half_length, half_width = fleet.length_m / 2, fleet.width_m / 2
    owner = fleet.owner if isinstance(fleet, Parts) else np.arange(fleet.num_robots)
    return _audit.Footprints(np.hypot(half_length, half_width), half_length, half_width, _rows(owner, np.int64))


def _outside_cabins(execution: Execution, fleet: Fleet, cabins: FloatArray | None) -> list[dict[str, Any]] | None:
    """Changes of level by bodies that are not wholly in a cabin, by time; None where nobody knows of cabins or levels."""
    level = execution.level
    if cabins is None or not len(cabins) or level is None:
        return None
    at, robot = np.nonzero(level[1:] != level[:-1])
    outside = []
    for k, r in zip(at.tolist(), robot.tolist()):
        for sample in (k, k + 1):
            here = cabins[cabins[:, 0] == level[sample, r]]
            x_m, y_m, yaw_rad = (float(column[sample, r]) for column in (execution.x_m, execution.y_m, execution.yaw_rad))
            if not (beyond_cabin_m(here, x_m, y_m, yaw_rad, float(fleet.length_m[r]), float(fleet.width_m[r])) <= CABIN_M).any():
                place = {"x_m": x_m, "y_m": y_m, "level": int(level[sample, r])}
                outside.append({"robot": fleet.robot_name[r], "t_s": float(execution.t_s[sample]), **place})
                break
    return outside


def _on_floors(execution: Execution, level: IntArray) -> Execution:
    """The execution without robots at the last sample before their levels change: they are in lifts."""
    leaves = np.zeros(level.shape, np.bool_)
    leaves[:-1] = level[1:] != level[:-1]
    return replace(execution, x_m=np.where(leaves, np.nan, execution.x_m), y_m=np.where(leaves, np.nan, execution.y_m))


def _apart(execution: Execution) -> Execution:
    """The execution with levels so far apart that robots on two of them are never the nearest."""
    return execution if execution.level is None else replace(execution, x_m=execution.x_m + FAR_M * execution.level)


def _closeness(execution: Execution, fleet: Fleet, level: IntArray | None) -> tuple[list[dict[str, Any]], dict[str, Any] | None]:
    """The first overlap of every pair, by time, and the least clearance."""
    poses = _poses(execution)
    if not len(poses.x):
        return [], None
    floor = np.zeros(fleet.num_robots, np.int64) if level is None else level.astype(np.int64)
    best, where, hits = _audit.closeness(poses, floor, _bodies(fleet))
    if not np.isfinite(best) or best > FAR_M / 2:
        return [], None

    pairs = sorted((_moment(execution.t_s, k, share), int(a), int(b)) for k, share, a, b in hits.tolist())
    overlaps = []
    for t_s, a, b in pairs:
        (xs,), (ys,), _ = positions_at(execution, np.array([t_s]))
        last = int(np.searchsorted(execution.t_s, t_s, side="right")) - 1  # where a robot is that is in a lift at the next sample
        for k in (last, min(last + 1, len(execution.t_s) - 1)):
            xs, ys = np.where(np.isnan(xs), execution.x_m[k], xs), np.where(np.isnan(ys), execution.y_m[k], ys)
        x_m = float(xs[a] + xs[b]) / 2
        place = {"x_m": x_m if execution.level is None else x_m - FAR_M * round(x_m / FAR_M), "y_m": float(ys[a] + ys[b]) / 2}
        overlaps.append({"robots": [fleet.robot_name[a], fleet.robot_name[b]], "t_s": t_s, **place})
    robots = [fleet.robot_name[int(r)] for r in where[2:]]
    return overlaps, {"m": float(best), "robots": robots, "t_s": _moment(execution.t_s, *where[:2].tolist())}


def _moment(t_s: FloatArray, k: float, share: float) -> float:
    """The time of a share of the way from a sample to the next."""
    before = float(t_s[int(k)])
    return before + share * (float(t_s[min(int(k) + 1, len(t_s) - 1)]) - before)


def _at_walls(execution: Execution, fleet: Fleet, walls: FloatArray | None) -> dict[str, Any]:
    """The first contact of every robot with every wall, by time, and the least distance of a footprint from a wall."""
    if walls is None:
        names = ("num_wall_contacts", "num_wall_crossings", "wall_contacts", "min_wall_clearance_m", "min_wall_clearance")
        return dict.fromkeys(names)
    best, where, hits = _nearest_walls(execution, fleet, walls)
    hits = hits[np.lexsort((hits[:, 3], hits[:, 2], hits[:, 0] + hits[:, 1]))]
    contacts = []
    for k, share, r, _, crosses in hits[:LISTED].tolist():
        robot, t_s = int(r), _moment(execution.t_s, k, share)
        (xs,), (ys,), _ = positions_at(execution, np.array([t_s]))
        place = {"x_m": float(xs[robot]), "y_m": float(ys[robot])}
        contacts.append({"robot": fleet.robot_name[robot], "t_s": t_s, **place, "crosses": bool(crosses)})
    k, share, r, _ = where.tolist()
    nearest = {"robot": fleet.robot_name[int(r)], "t_s": _moment(execution.t_s, k, share)} if np.isfinite(best) else None
    return {
        "num_wall_contacts": len(hits),
        "num_wall_crossings": int(hits[:, 4].sum()),
        "wall_contacts": contacts,
        "min_wall_clearance_m": float(best) if nearest else None,
        "min_wall_clearance": nearest,
    }


def _among_people(execution: Execution, fleet: Fleet, towed: range) -> dict[str, Any]:
    """Contacts of footprints with people, and robots that are faster than their fields allow; those that are towed have none."""
    log, names = execution.people, ("num_person_contacts", "num_person_touches", "person_contacts")
    if log is None or not len(execution.t_s):
        return dict.fromkeys((*names, "num_field_violations", "field_violations", "min_person_distance_m"))
    bodies = _bodies(fleet)
    shapes = bodies.half_length, bodies.half_width, bodies.radius, _rows(fleet.decel_mps2), fleet.is_vehicle
    touches, fast, nearest = _people.meet_people(
        _people.RobotSamples(*_poses(execution), _rows(execution.speed_mps), *shapes, execution.period_s),
        _people.Sightings(log.first, log.person, log.x_m, log.y_m, log.radius_m),
        _people.FieldRules(log.extra_m, log.reaction_s, log.side_m, log.slowest_mps),
    )
    fast = fast[~np.isin(fast[:, 1], towed)]
    kinds, num_fast = ("standing", "braking", "too_fast"), int((touches[:, 3] == _people.TOO_FAST).sum())

    def where(k: float, r: float) -> dict[str, Any]:
        return {"robot": fleet.robot_name[int(r)], "t_s": float(execution.t_s[int(k)])}

    worst = touches[np.argsort(-touches[:, 3], kind="stable")[:LISTED]]
    return {
        "num_person_contacts": num_fast,
        "num_person_touches": len(touches) - num_fast,
        "person_contacts": [{**where(k, r), "person": int(p), "kind": kinds[int(kind)]} for k, r, p, kind in worst.tolist()],
        "num_field_violations": len(fast),
        "field_violations": [{**where(k, r), "speed_mps": v} for k, r, v in fast[:LISTED].tolist()],
        "min_person_distance_m": float(nearest[0]) if np.isfinite(nearest[0]) else None,
    }


def _nearest_walls(execution: Execution, fleet: Fleet, walls: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """What the kernel finds; robots are looked at with the walls of the square that they are in, and farther ones where there are none."""
    poses, bodies = _poses(execution), _bodies(fleet)
    if not len(walls) or (extent := _extent(poses.x, poses.y)) is None:
        return np.inf, np.zeros(4), np.zeros((0, 5))
    low, high, moved_m = extent
    side_m = max(PLACE_M, float((high - low).max()) / MOST_PLACES)
    cell, corner = _squares(poses.x, poses.y, low, high, side_m)
    along = walls[:, 1] - walls[:, 0]
    bearing = np.arctan2(along[:, 1], along[:, 0])
    strokes = np.column_stack([walls.mean(axis=1), bearing, np.hypot(*along.T) / 2, np.cos(bearing), np.sin(bearing)])
    boxes = np.concatenate([walls.min(axis=1), walls.max(axis=1)], axis=1)
    around_m = float(bodies.radius.max()) + moved_m
    everything = np.concatenate([[low, high], walls.reshape(-1, 2)])
    farthest_m, look_m = float(np.hypot(*np.ptp(everything, axis=0))) + around_m, LOOK_M
    while True:
        near_m = around_m + look_m
        i, j = overlapping(np.concatenate([corner - near_m, corner + side_m + near_m], axis=1), boxes)
        first = np.searchsorted(i, np.arange(len(corner) + 1))
        best, where, hits = _walls.wall_closeness(poses, bodies, cell, first, j, strokes, look_m)
        if where[2] >= 0:
            return best, where, hits
        if look_m > farthest_m:
            return np.inf, where, hits
        look_m *= 8


def _extent(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, float] | None:
    """The corners [2] of the least rectangle around all robots at all times, and the farthest that one moved between two samples, in m."""
    low, high, moved_m = np.full(2, np.inf), np.full(2, -np.inf), 0.0
    for begin in range(0, len(x), TOGETHER):
        some_x, some_y = x[begin : begin + TOGETHER + 1], y[begin : begin + TOGETHER + 1]
        here = np.isfinite(some_x) & np.isfinite(some_y)
        if here.any():
            xy = np.stack([some_x[here], some_y[here]], axis=1)
            low, high = np.minimum(low, xy.min(axis=0)), np.maximum(high, xy.max(axis=0))
        moved = np.hypot(np.diff(some_x, axis=0), np.diff(some_y, axis=0))
        moved_m = max(moved_m, float(moved[np.isfinite(moved)].max(initial=0.0)))
    return (low, high, moved_m) if np.isfinite(low).all() else None


def _squares(x: FloatArray, y: FloatArray, low: FloatArray, high: FloatArray, side_m: float) -> tuple[IntArray, FloatArray]:
    """[T, R] the square that each robot is in, -1 where it is absent, and [P, 2] the lower left corners of those that any is in."""
    columns, rows = (np.floor((high - low) / side_m).astype(np.int64) + 1).tolist()
    is_used, cell = np.zeros(columns * rows, np.bool_), np.full(x.shape, -1, np.int64)
    blocks = [slice(begin, begin + TOGETHER) for begin in range(0, len(x), TOGETHER)]
    for block in blocks:
        here = np.isfinite(x[block]) & np.isfinite(y[block])
        column, row = np.floor((np.stack([x[block][here], y[block][here]], axis=1) - low) / side_m).astype(np.int64).T
        square = column * rows + row
        is_used[square] = True
        cell[block][here] = square
    number = np.append(np.cumsum(is_used) - 1, -1)  # -1 stays
    for block in blocks:
        cell[block] = number[cell[block]]
    place = np.flatnonzero(is_used)
    return cell, low + side_m * np.stack([place // rows, place % rows], axis=1)


def _motion(execution: Execution, fleet: Fleet) -> tuple[dict[str, int], list[dict[str, Any]]]:
    first = np.zeros((len(KINDS), LISTED, 4))
    t, speed = _rows(execution.t_s), _rows(execution.speed_mps)
    limits = (_rows(v) for v in (fleet.max_speed_mps, fleet.accel_mps2, fleet.decel_mps2, _turn_rates(fleet)))
    counts = _audit.over_limits(t, _at_axles(execution, fleet), speed, _audit.MotionLimits(*limits), first).tolist()
    violations = [
        {"kind": kind, "robot": fleet.robot_name[int(r)], "t_s": float(execution.t_s[int(k)]), "value": value, "limit": limit}
        for kind, count, rows in zip(KINDS, counts, first.tolist())
        for k, r, value, limit in rows[:count]
    ]
    return dict(zip(KINDS.values(), counts)), violations


def _turn_rates(fleet: Fleet) -> FloatArray:
    """[R] at which robots turn: in place, or on the tightest arc."""
    least_m = fleet.least_radius_m
    return np.where(least_m > 0, fleet.max_speed_mps / np.maximum(least_m, 1e-9), fleet.turn_rate_rad_s)


def _at_axles(execution: Execution, fleet: Fleet) -> _audit.Poses:
    """Poses of what keeps the limits of motion: the middle of the body, of vehicles that of their fixed axle."""
    if not fleet.vehicle_of_kind:
        return _poses(execution)
    x, y = axle_of(execution.x_m, execution.y_m, execution.yaw_rad, fleet.ahead_m)
    return _audit.Poses(_rows(x), _rows(y), _rows(execution.yaw_rad))


def _elsewhere(execution: Execution, fleet: Fleet) -> tuple[list[dict[str, Any]], float | None]:
    """Robots that SUMO had elsewhere than the trajectory, the first time for each, and the most it was off."""
    if not len(execution.sumo_t_s) or not len(execution.t_s):
        return [], None
    x, y, _ = positions_at(execution, execution.sumo_t_s)
    apart = np.hypot(execution.sumo_xy_m[..., 0] - x, execution.sumo_xy_m[..., 1] - y)  # [K, R]
    away = apart > ELSEWHERE_M
    jumps = [
        {"robot": fleet.robot_name[r], "t_s": float(execution.sumo_t_s[k]), "apart_m": float(apart[k, r])}
        for k, r in sorted((int(away[:, r].argmax()), r) for r in np.flatnonzero(away.any(0)).tolist())
    ]
    return jumps, float(np.nanmax(apart)) if np.isfinite(apart).any() else None


def _rows(values: NDArray[Any], of: type[np.generic] = np.float64) -> NDArray[Any]:
    """As the kernels take it: one type of array, whoever made it."""
    rows: NDArray[Any] = np.ascontiguousarray(values, of).view()
    rows.flags.writeable = False
    return rows
