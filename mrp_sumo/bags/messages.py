"""ROS 2 messages of a run, serialised, for the topics that are published once.

Frames: `world` -> `map` (equal) -> `<robot>/base_link`. Where robots change levels, these lie beside each other in `map`, and each has
a frame of its own there. Stamps are EPOCH_NS plus simulated time, a constant, so that equal runs give equal bytes (0 would mean "latest"
to many readers).
"""

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mrp_sumo.bags.template import tiled
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray
from mrp_sumo.errors import MrpSumoError, nearest
from mrp_sumo.files.names import distinct
from mrp_sumo.io.events import event_document
from mrp_sumo.io.record import RunRecord, task_names_at

EPOCH_NS = 1_700_000_000 * 10**9
GENERATIONS = ("galactic", "jazzy", "kilted")
FLEET_NAME = "mrp_sumo"
MAP_Z_M = -0.02  # a viewer that draws the map at the height of lanes and points hides these (Foxglove does)
LABEL_OFFSET = 0.4 * np.array([math.cos(0.7853), math.sin(0.7853)])  # where MRP-Bench's graph reader looks for names


@cache
def typestore(generation: str) -> Any:
    """Message types: those of ROS 2 Humble, rmf_fleet_msgs in a generation, and rmf_lift_msgs, rmf_door_msgs and people_msgs, which are
    the same in all.

    Raises MrpSumoError for an unknown generation.
    """
    if generation not in GENERATIONS:
        raise MrpSumoError(f"unknown generation '{generation}' of rmf_fleet_msgs{nearest(generation, GENERATIONS)}")
    store, types = get_typestore(Stores.ROS2_HUMBLE), {}
    packages = [(generation, "rmf_fleet_msgs"), ("facilities", "rmf_lift_msgs"), ("facilities", "rmf_door_msgs")]
    packages += [("people", "people_msgs")]
    for above, package in packages:
        folder = resources.files("mrp_sumo.bags") / "msgs" / above / package / "msg"
        for file in sorted(folder.iterdir(), key=lambda f: f.name):
            types.update(get_types_from_msg(file.read_text(encoding="utf-8"), f"{package}/msg/{file.name.removesuffix('.msg')}"))
    store.register(types)
    return store


def ros_names(names: Iterable[str]) -> list[str]:
    """Names as tokens that ROS accepts in topics and frames, kept distinct: 'robot.1' becomes 'robot_1'."""
    plain = (re.sub(r"[^A-Za-z0-9_]", "_", name) or "_" for name in names)
    return distinct(f"r_{token}" if token[0].isdigit() else token for token in plain)


class Messages:
    """Builds the messages of one record."""

    def __init__(self, record: RunRecord, generation: str = "jazzy") -> None:
        self.record = record
        self.typestore = typestore(generation)
        self.robots = ros_names(record.fleet.robot_name)
        self.generation = generation
        self.level_names = record.graph.level_names or ("L1",)
        self.shift_m = record.shift_m  # of levels in `map`
        self.plan = record.plan  # in force: the writer moves on to later ones

    def message(self, typename: str, *values: Any) -> bytes:
        """As `make`, serialised by the library."""
        made = self.make(typename, *values)
        return bytes(self.typestore.serialize_cdr(made, made.__msgtype__))

    def make(self, typename: str, *values: Any, **named: Any) -> Any:
        """A message by its short name 'package/Type'."""
        package, name = typename.split("/")
        return self.typestore.types[f"{package}/msg/{name}"](*values, **named)

    def time(self, ns: int) -> Any:
        return self.make("builtin_interfaces/Time", *divmod(ns, 10**9))

    def header(self, ns: int, frame: str) -> Any:
        return self.make("std_msgs/Header", self.time(ns), frame)

    def pose(self, x: float = 0.0, y: float = 0.0, yaw: float = 0.0, z: float = 0.0) -> Any:
        return self.make("geometry_msgs/Pose", self.point(x, y, z), self.turn(math.sin(yaw / 2), math.cos(yaw / 2)))

    def point(self, x: float, y: float, z: float = 0.0) -> Any:
        return self.make("geometry_msgs/Point", float(x), float(y), z)

    def turn(self, z: float, w: float) -> Any:
        return self.make("geometry_msgs/Quaternion", 0.0, 0.0, z, w)

    def vector(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
        return self.make("geometry_msgs/Vector3", float(x), float(y), float(z))

    def transform(self, ns: int, frame: str, child: str, x: float, y: float) -> Any:
        """A shift without a turn."""
        moved = self.make("geometry_msgs/Transform", self.vector(x, y), self.turn(0.0, 1.0))
        return self.make("geometry_msgs/TransformStamped", self.header(ns, frame), child, moved)

    def tf_static(self, ns: int) -> bytes:
        """The transform from world to map."""
        levels = zip(ros_names(self.level_names), self.shift_m.tolist()) if self.record.levels else ()
        frames = [self.transform(ns, "map", name, x, y) for name, (x, y) in levels]
        return self.message("tf2_msgs/TFMessage", [self.transform(ns, "world", "map", 0.0, 0.0), *frames])

    def map(self, ns: int) -> bytes:
        """Walls as an occupancy grid; without walls, the cells that no lane touches; without either, a free grid."""
        origin, resolution_m, occupied = self._occupied()
        height, width = occupied.shape
        info = self.make(
            "nav_msgs/MapMetaData",
            self.time(ns),
            float(np.float32(resolution_m)),
            width,
            height,
            self.pose(float(origin[0]), float(origin[1]), z=MAP_Z_M),
        )
        cells = np.where(occupied, 100, 0).astype(np.int8).ravel()
        return self.message("nav_msgs/OccupancyGrid", self.header(ns, "map"), info, cells)

    def _occupied(self) -> tuple[Any, float, BoolArray]:
        costmap, graph = self.record.costmap, self.record.graph
        if costmap is not None:
            return costmap.origin_m, costmap.resolution_m, costmap.occupied
        if not graph.num_vertices:
            return (0.0, 0.0), 1.0, np.zeros((1, 1), np.bool_)
        low, high = graph.xy.min(0), graph.xy.max(0)
        if graph.kind != "grid":
            shape = np.ceil((high - low) / 0.5).astype(np.int64) + 3
            return low - 0.5, 0.5, np.zeros((shape[1], shape[0]), np.bool_)
        cell = np.rint((graph.xy - low) / graph.cell_m).astype(np.int64)
        occupied = np.ones((cell[:, 1].max() + 1, cell[:, 0].max() + 1), np.bool_)
        occupied[cell[:, 1], cell[:, 0]] = False
        return low - graph.cell_m / 2, graph.cell_m, occupied

    def map_markers(self, ns: int) -> bytes:
        """The map's vertices, lanes and names, as MRP-Bench's graph reader expects them."""
        nav = self.record.drawn
        points = [self.point(x, y) for x, y in nav.xy.tolist()]
        once = np.flatnonzero(nav.is_once)
        ends = [points[v] for pair in zip(nav.tail[once].tolist(), nav.head[once].tolist()) for v in pair]
        size = float(self.record.fleet.width_m.max()) if self.record.fleet.num_robots else 0.2
        markers = [
            self.marker(ns, "map", "vertices", 0, 8, scale=(size, size, 0.0), color=(0.35, 0.40, 0.50, 1.0), points=points),
            self.marker(ns, "map", "lanes", 0, 5, scale=(size / 4, 0.0, 0.0), color=(0.55, 0.60, 0.68, 0.8), points=ends),
        ]
        for v in (v for v in range(nav.num_vertices) if nav.vertex_name[v]):
            x, y = nav.xy[v] + LABEL_OFFSET
            pose, text = self.pose(float(x), float(y)), nav.known_as(v)
            look = {"scale": (0.0, 0.0, 0.35), "color": (0.15, 0.15, 0.20, 1.0)}
            markers.append(self.marker(ns, "map", "names", v, 9, **look, pose=pose, text=text))
        return self.message("visualization_msgs/MarkerArray", markers)

    def robot_markers(self, ns: int) -> bytes:
        """A box and a name for each robot, attached to its frame, so that TF moves them."""
        fleet, markers = self.record.fleet, []
        for i, name in enumerate(self.robots):
            frame, height = f"{name}/base_link", float(fleet.width_m[i]) / 2
            box = {"scale": (float(fleet.length_m[i]), float(fleet.width_m[i]), height), "color": (*_colour_of(i), 1.0)}
            words = {"scale": (0.0, 0.0, 0.25), "color": (0.1, 0.1, 0.1, 1.0), "text": fleet.robot_name[i]}
            markers.append(self.marker(ns, frame, "body", i, 1, **box, pose=self.pose(z=height / 2), frame_locked=True))
            markers.append(self.marker(ns, frame, "name", i, 9, **words, pose=self.pose(z=2 * height + 0.1), frame_locked=True))
        return self.message("visualization_msgs/MarkerArray", markers)

    def plan_markers(self, ns: int) -> bytes:
        """The planned path of each robot that moves."""
        markers, plan = [], self.plan
        width = float(self.record.fleet.width_m.min()) / 3 if self.record.fleet.num_robots else 0.1
        for i in range(plan.num_robots if plan else 0):
            assert plan is not None
            xy = _corners(self.record.graph.xy[plan.vertex[plan.first[i] : plan.first[i + 1]]])
            if len(xy) > 1:
                points = [self.point(x, y) for x, y in xy.tolist()]
                look = {"scale": (width, 0.0, 0.0), "color": (*_colour_of(i), 0.7)}
                markers.append(self.marker(ns, "map", "plan", i, 4, **look, points=points))
        return self.message("visualization_msgs/MarkerArray", markers)

    def marker(self, ns: int, frame: str, group: str, number: int, kind: int, **fields: Any) -> Any:
        """A marker; kinds: 1 CUBE, 4 LINE_STRIP, 5 LINE_LIST, 7 SPHERE_LIST, 8 POINTS, 9 TEXT_VIEW_FACING.

        `fields` are others of the message; `scale` and `color` are tuples.
        """
        nothing = np.zeros(0, np.uint8)
        fields["scale"] = self.vector(*fields["scale"])
        fields["color"] = self.make("std_msgs/ColorRGBA", *fields["color"])
        usual = {
            "header": self.header(ns, frame),
            "ns": group,
            "id": number,
            "type": kind,
            "action": 0,
            "pose": self.pose(),
            "lifetime": self.make("builtin_interfaces/Duration", 0, 0),
            "frame_locked": False,
            "points": [],
            "colors": [],
            "texture_resource": "",
            "texture": self.make("sensor_msgs/CompressedImage", self.header(0, ""), "", nothing),
            "uv_coordinates": [],
            "text": "",
            "mesh_resource": "",
            "mesh_file": self.make("visualization_msgs/MeshFile", "", nothing),
            "mesh_use_embedded_materials": False,
        }
        return self.make("visualization_msgs/Marker", **usual | fields)

    def path_requests(self, since: Mapping[int, int] | None = None, at_ns: int = EPOCH_NS) -> Iterator[bytes]:
        """The plan of each robot as RMF states it; `Location.t` is the planned time, a wait is two locations.

        With `since`, that of some robots only, from these visits along their ways on, as they were sent at `at_ns`.
        """
        plan = self.plan
        (tasks,) = task_names_at(self.record, np.array([(at_ns - EPOCH_NS) / 1e9]))
        for i in range(plan.num_robots if plan else 0) if since is None else since:
            assert plan is not None
            visits = slice(int(plan.first[i]) + (since[i] if since else 0), int(plan.first[i + 1]))
            vertex, arrive, depart = plan.vertex[visits], plan.arrive_s[visits], plan.depart_s[visits]
            xy = self.record.graph.xy[vertex]
            yaw = _headings(xy)
            waits = np.isfinite(depart) & (depart > arrive + 1e-6)
            row, t_s = np.repeat(np.arange(len(vertex)), 1 + waits), np.repeat(arrive, 1 + waits)
            t_s[np.flatnonzero(row[1:] == row[:-1]) + 1] = depart[waits]
            ns = EPOCH_NS + np.rint(t_s * 1e9).astype(np.int64)
            yield self._path_request(i, str(tasks[i]), ns, xy[row], yaw[row], vertex[row])

    def _path_request(self, robot: int, task: str, ns: IntArray, xy: FloatArray, yaw: FloatArray, vertex: IntArray) -> bytes:
        level = self.record.graph.level[vertex]
        xy = xy - self.shift_m[level]
        kind = "rmf_fleet_msgs/PathRequest"

        def serialised(marks: Sequence[int]) -> bytes:
            path = [self.location(0.0, 0.0, 0.0, int(level[0]), t=self.make("builtin_interfaces/Time", mark, 0)) for mark in marks]
            return self.message(kind, FLEET_NAME, self.robots[robot], path, task)

        if (level != level[0]).any():  # locations differ in length
            rows = zip(ns.tolist(), *xy.T.tolist(), yaw.tolist(), level.tolist(), vertex.tolist())
            path = [self.location(x, y, turned, on, v, t=self.time(t)) for t, x, y, turned, on, v in rows]
            return self.message(kind, FLEET_NAME, self.robots[robot], path, task)
        raw, first, second, stride = tiled(serialised, len(ns))
        names, formats = ["sec", "nanosec", "x", "y", "yaw", "index"], ["<i4", "<u4", "<f4", "<f4", "<f4", "<u8"]
        for begin, end, part in ((first, second, slice(0, 1)), (second, second + stride * (len(ns) - 1), slice(1, None))):
            size = end - begin if part.stop else stride
            at = np.dtype({"names": names, "formats": formats, "offsets": [0, 4, 8, 12, 16, size - 8], "itemsize": size})
            locations = raw[begin:end].view(at)
            locations["sec"], locations["nanosec"] = ns[part] // 10**9, ns[part] % 10**9
            locations["x"], locations["y"], locations["yaw"] = xy[part, 0], xy[part, 1], yaw[part]
            locations["index"] = vertex[part]
        return raw.tobytes()

    def location(self, x: Any, y: Any, yaw: Any, level: int, vertex: int = 0, *, t: Any) -> Any:
        limit = () if self.generation == "galactic" else (False, 0.0)
        return self.make("rmf_fleet_msgs/Location", t, x, y, yaw, *limit, self.level_names[level], vertex)

    def path(self, ns: int, robot: int) -> bytes:
        """nav_msgs/Path of one robot; pose stamps are planned arrivals."""
        plan = self.plan
        poses = []
        if plan is not None:
            visits = slice(int(plan.first[robot]), int(plan.first[robot + 1]))
            xy = self.record.graph.xy[plan.vertex[visits]]
            for t, (x, y), yaw in zip(plan.arrive_s[visits].tolist(), xy.tolist(), _headings(xy).tolist()):
                poses.append(self.make("geometry_msgs/PoseStamped", self.header(EPOCH_NS + round(t * 1e9), "map"), self.pose(x, y, yaw)))
        return self.message("nav_msgs/Path", self.header(ns, "map"), poses)

    def logs(self) -> Iterator[tuple[int, bytes]]:
        """(ns, message) of each event, by time; each message holds one JSON object."""
        for event in sorted(self.record.execution.events, key=lambda e: e.t_s):
            ns = EPOCH_NS + max(0, round(event.t_s * 1e9))
            level = {"deadlock": 40, "collision": 40, "blocked_for_good": 40, "blocked": 30}.get(event.kind, 20)
            text = json.dumps(event_document(event, self.record.fleet, self.record.graph), ensure_ascii=False, allow_nan=False)
            name = self.robots[event.robot] if event.robot >= 0 else FLEET_NAME
            yield ns, self.message("rcl_interfaces/Log", self.time(ns), level, name, text, "", "", 0)


def _corners(xy: FloatArray) -> FloatArray:
    """The polyline without repeated points and points on straight pieces."""
    xy = xy[np.concatenate(([True], (np.diff(xy, axis=0) != 0).any(1)))] if len(xy) else xy
    if len(xy) < 3:
        return xy
    before, after = np.diff(xy, axis=0)[:-1], np.diff(xy, axis=0)[1:]
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    ahead = (before * after).sum(1) > 0
    straight = ahead & (np.abs(cross) <= 1e-9 * np.hypot(*before.T) * np.hypot(*after.T))
    return xy[np.concatenate(([True], ~straight, [True]))]


def _headings(xy: FloatArray) -> FloatArray:
    """[N] heading towards the next point; the last point keeps the heading before it."""
    if len(xy) < 2:
        return np.zeros(len(xy))
    step = np.diff(xy, axis=0)
    yaw = np.arctan2(step[:, 1], step[:, 0])
    return np.append(yaw, yaw[-1])


def _colour_of(robot: int) -> tuple[float, float, float]:
    """A colour that differs from those of the robots nearby in number."""
    hue = (robot * 0.618033988749895) % 1.0
    tone: NDArray[np.float64] = 0.55 + 0.4 * np.cos(2 * np.pi * (hue + np.array([0.0, 1 / 3, 2 / 3])))
    return tuple(round(float(c), 3) for c in tone)  # type: ignore[return-value]
