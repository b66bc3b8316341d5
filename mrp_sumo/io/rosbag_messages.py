"""ROS 2 messages of a run, serialised: what each topic of a bag says.

Topics that are said once build message objects; streams overwrite the numbers of a template. Frames:
`world` -> `map` (equal) -> `<robot>/base_link`. Stamps are EPOCH_NS plus simulated time, a constant,
so that equal runs give equal bytes (0 would mean "latest" to many readers).
"""

import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial import cKDTree

from mrp_sumo.core.execution import positions_at
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray
from mrp_sumo.errors import MrpSumoError, nearest
from mrp_sumo.io.events import event_document
from mrp_sumo.io.record import AT_GOAL, BLOCKED, MOVING, STATE_NAMES, WAITING, Record, robot_states
from mrp_sumo.io.rosbag_template import Template, tiled

EPOCH_NS = 1_700_000_000 * 10**9
GENERATIONS = ("galactic", "jazzy", "kilted")
FLEET_NAME = "mrp_sumo"
COLOURS = {MOVING: (0.18, 0.55, 0.95), WAITING: (0.95, 0.70, 0.10), BLOCKED: (0.90, 0.20, 0.15), AT_GOAL: (0.25, 0.70, 0.35)}
RMF_MODES = {MOVING: 2, WAITING: 4, BLOCKED: 4, AT_GOAL: 0}  # RobotMode: MODE_MOVING, MODE_WAITING, MODE_IDLE
CLOUD = np.dtype(
    {
        "names": ["x", "y", "z", "rgb", "speed", "yaw", "id", "blocked"],
        "formats": ["<f4", "<f4", "<f4", "<u4", "<f4", "<f4", "<u4", "u1"],
        "offsets": [0, 4, 8, 12, 16, 20, 24, 28],
        "itemsize": 32,
    }
)
LABEL_OFFSET = 0.4 * np.array([math.cos(0.7853), math.sin(0.7853)])  # where MRP-Bench's graph reader looks for names


@cache
def typestore(generation: str) -> Any:
    """Humble's message types and those of rmf_fleet_msgs in a generation.

    Raises
    ------
    MrpSumoError
        For a generation that is not known.
    """
    if generation not in GENERATIONS:
        raise MrpSumoError(f"unknown generation '{generation}' of rmf_fleet_msgs{nearest(generation, GENERATIONS)}")
    store, types = get_typestore(Stores.ROS2_HUMBLE), {}
    folder = resources.files("mrp_sumo.io") / "msgs" / generation / "rmf_fleet_msgs" / "msg"
    for file in sorted(folder.iterdir(), key=lambda f: f.name):
        types.update(get_types_from_msg(file.read_text(encoding="utf-8"), f"rmf_fleet_msgs/msg/{file.name.removesuffix('.msg')}"))
    store.register(types)
    return store


def ros_names(names: Iterable[str]) -> list[str]:
    """The names as tokens ROS takes in topics and frames, kept distinct: 'robot.1' becomes 'robot_1'."""
    taken: set[str] = set()
    tokens = []
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_]", "_", name) or "_"
        plain = plain if not plain[0].isdigit() else f"r_{plain}"
        token, number = plain, 2
        while token in taken:
            token, number = f"{plain}_{number}", number + 1
        taken.add(token)
        tokens.append(token)
    return tokens


class Samples:
    """Positions and states of all robots at the times a bag speaks of. K times, R robots."""

    def __init__(self, record: Record, t_ns: IntArray) -> None:
        execution = record.execution
        self.t_ns = t_ns
        self.x, self.y, self.yaw = positions_at(execution, t_ns / 1e9)
        sample = np.clip(np.searchsorted(execution.t_s, t_ns / 1e9 - 1e-9), 0, len(execution.t_s) - 1)
        self.speed = execution.speed_mps[sample]
        self.state = robot_states(execution, t_ns / 1e9)
        self.there: BoolArray = np.isfinite(self.x) & np.isfinite(self.y)


class Messages:
    """Builds the messages of one record."""

    def __init__(self, record: Record, generation: str = "jazzy") -> None:
        self.record = record
        self.typestore = typestore(generation)
        self.robots = ros_names(record.fleet.robot_name)
        self.generation = generation
        self.level_name = (record.nav or record.graph).level_names[0] if (record.nav or record.graph).level_names else "L1"

    def serialised(self, message: Any) -> bytes:
        """Through the library."""
        return bytes(self.typestore.serialize_cdr(message, message.__msgtype__))

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

    def transform(self, ns: int, frame: str, child: str, x: float, y: float, qz: float, qw: float) -> Any:
        moved = self.make("geometry_msgs/Transform", self.vector(x, y), self.turn(qz, qw))
        return self.make("geometry_msgs/TransformStamped", self.header(ns, frame), child, moved)

    # said once

    def tf_static(self, ns: int) -> bytes:
        """The map's place in the world."""
        return self.serialised(self.make("tf2_msgs/TFMessage", [self.transform(ns, "world", "map", 0.0, 0.0, 0.0, 1.0)]))

    def map(self, ns: int) -> bytes:
        """Walls as an occupancy grid; without walls, cells no lane touches; without either, nothing occupied."""
        origin, resolution_m, occupied = self._occupied()
        height, width = occupied.shape
        info = self.make(
            "nav_msgs/MapMetaData",
            self.time(ns),
            float(np.float32(resolution_m)),
            width,
            height,
            self.pose(float(origin[0]), float(origin[1])),
        )
        cells = np.where(occupied, 100, 0).astype(np.int8).ravel()
        return self.serialised(self.make("nav_msgs/OccupancyGrid", self.header(ns, "map"), info, cells))

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
        """The map's vertices, lanes and names, as MRP-Bench's graph reader takes them."""
        nav = self.record.nav or self.record.graph
        points = [self.point(x, y) for x, y in nav.xy.tolist()]
        once = np.flatnonzero((nav.reverse < 0) | (nav.tail < nav.head))
        ends = [points[v] for pair in zip(nav.tail[once].tolist(), nav.head[once].tolist()) for v in pair]
        size = float(self.record.fleet.width_m.max()) if self.record.fleet.num_robots else 0.2
        markers = [
            self.marker(ns, "map", "vertices", 0, 8, (size, size, 0.0), (0.35, 0.40, 0.50, 1.0), points=points),
            self.marker(ns, "map", "lanes", 0, 5, (size / 4, 0.0, 0.0), (0.55, 0.60, 0.68, 0.8), points=ends),
        ]
        for v in (v for v in range(nav.num_vertices) if nav.vertex_name[v]):
            x, y = nav.xy[v] + LABEL_OFFSET
            pose, text = self.pose(float(x), float(y)), nav.vertex_name[v]
            markers.append(self.marker(ns, "map", "names", v, 9, (0.0, 0.0, 0.35), (0.15, 0.15, 0.20, 1.0), pose=pose, text=text))
        return self.serialised(self.make("visualization_msgs/MarkerArray", markers))

    def robot_markers(self, ns: int) -> bytes:
        """A box and a name for each robot, fixed to its frame: TF moves them."""
        fleet, markers = self.record.fleet, []
        for i, name in enumerate(self.robots):
            frame, height = f"{name}/base_link", float(fleet.width_m[i]) / 2
            scale, colour = (float(fleet.length_m[i]), float(fleet.width_m[i]), height), (*_colour_of(i), 1.0)
            markers.append(self.marker(ns, frame, "body", i, 1, scale, colour, pose=self.pose(z=height / 2), locked=True))
            above = self.pose(z=2 * height + 0.1)
            markers.append(
                self.marker(
                    ns, frame, "name", i, 9, (0.0, 0.0, 0.25), (0.1, 0.1, 0.1, 1.0), pose=above, text=fleet.robot_name[i], locked=True
                )
            )
        return self.serialised(self.make("visualization_msgs/MarkerArray", markers))

    def plan_markers(self, ns: int) -> bytes:
        """The planned path of each robot that moves."""
        markers, plan = [], self.record.plan
        width = float(self.record.fleet.width_m.min()) / 3 if self.record.fleet.num_robots else 0.1
        for i in range(plan.num_robots if plan else 0):
            assert plan is not None
            xy = _corners(self.record.graph.xy[plan.vertex[plan.first[i] : plan.first[i + 1]]])
            if len(xy) > 1:
                points = [self.point(x, y) for x, y in xy.tolist()]
                markers.append(self.marker(ns, "map", "plan", i, 4, (width, 0.0, 0.0), (*_colour_of(i), 0.7), points=points))
        return self.serialised(self.make("visualization_msgs/MarkerArray", markers))

    def marker(
        self,
        ns: int,
        frame: str,
        group: str,
        number: int,
        kind: int,
        scale: tuple[float, float, float],
        colour: tuple[float, float, float, float],
        *,
        pose: Any = None,
        points: Sequence[Any] = (),
        text: str = "",
        locked: bool = False,
    ) -> Any:
        """A marker; kinds: 1 CUBE, 4 LINE_STRIP, 5 LINE_LIST, 8 POINTS, 9 TEXT_VIEW_FACING."""
        nothing = np.zeros(0, np.uint8)
        return self.make(
            "visualization_msgs/Marker",
            header=self.header(ns, frame),
            ns=group,
            id=number,
            type=kind,
            action=0,
            pose=pose or self.pose(),
            scale=self.vector(*scale),
            color=self.make("std_msgs/ColorRGBA", *colour),
            lifetime=self.make("builtin_interfaces/Duration", 0, 0),
            frame_locked=locked,
            points=list(points),
            colors=[],
            texture_resource="",
            texture=self.make("sensor_msgs/CompressedImage", self.header(0, ""), "", nothing),
            uv_coordinates=[],
            text=text,
            mesh_resource="",
            mesh_file=self.make("visualization_msgs/MeshFile", "", nothing),
            mesh_use_embedded_materials=False,
        )

    def path_requests(self) -> Iterator[bytes]:
        """The plan of each robot as RMF states it; `Location.t` is the planned time, a wait is said twice."""
        plan = self.record.plan
        for i in range(plan.num_robots if plan else 0):
            assert plan is not None
            visits = slice(int(plan.first[i]), int(plan.first[i + 1]))
            vertex, arrive, depart = plan.vertex[visits], plan.arrive_s[visits], plan.depart_s[visits]
            xy = self.record.graph.xy[vertex]
            yaw = _headings(xy)
            waits = np.isfinite(depart) & (depart > arrive + 1e-6)
            row, t_s = np.repeat(np.arange(len(vertex)), 1 + waits), np.repeat(arrive, 1 + waits)
            t_s[np.flatnonzero(row[1:] == row[:-1]) + 1] = depart[waits]
            ns = EPOCH_NS + np.rint(t_s * 1e9).astype(np.int64)
            yield self._path_request(i, ns, xy[row], yaw[row], vertex[row])

    def _path_request(self, robot: int, ns: IntArray, xy: FloatArray, yaw: FloatArray, vertex: IntArray) -> bytes:
        """One request with K locations."""
        task = self.record.graph.label(int(self.record.target[robot]))

        def serialised(marks: Sequence[int]) -> bytes:
            path = [self.location(0, 0.0, 0.0, 0.0, t=self.make("builtin_interfaces/Time", mark, 0)) for mark in marks]
            return self.serialised(self.make("rmf_fleet_msgs/PathRequest", FLEET_NAME, self.robots[robot], path, task))

        raw, first, second, stride = tiled(serialised, len(ns))
        names, formats = ["sec", "nanosec", "x", "y", "yaw", "index"], ["<i4", "<u4", "<f4", "<f4", "<f4", "<u8"]
        for begin, end, rows in ((first, second, slice(0, 1)), (second, second + stride * (len(ns) - 1), slice(1, None))):
            size = end - begin if rows.stop else stride
            at = np.dtype({"names": names, "formats": formats, "offsets": [0, 4, 8, 12, 16, size - 8], "itemsize": size})
            locations = raw[begin:end].view(at)
            locations["sec"], locations["nanosec"] = ns[rows] // 10**9, ns[rows] % 10**9
            locations["x"], locations["y"], locations["yaw"] = xy[rows, 0], xy[rows, 1], yaw[rows]
            locations["index"] = vertex[rows]
        return raw.tobytes()

    def location(self, ns: int, x: Any, y: Any, yaw: Any, vertex: int = 0, t: Any = None) -> Any:
        limit = () if self.generation == "galactic" else (False, 0.0)
        return self.make("rmf_fleet_msgs/Location", t or self.time(ns), x, y, yaw, *limit, self.level_name, vertex)

    def path(self, ns: int, robot: int) -> bytes:
        """nav_msgs/Path of one robot; pose stamps are planned arrivals."""
        plan = self.record.plan
        poses = []
        if plan is not None:
            visits = slice(int(plan.first[robot]), int(plan.first[robot + 1]))
            xy = self.record.graph.xy[plan.vertex[visits]]
            for t, (x, y), yaw in zip(plan.arrive_s[visits].tolist(), xy.tolist(), _headings(xy).tolist()):
                poses.append(self.make("geometry_msgs/PoseStamped", self.header(EPOCH_NS + round(t * 1e9), "map"), self.pose(x, y, yaw)))
        return self.serialised(self.make("nav_msgs/Path", self.header(ns, "map"), poses))

    def logs(self) -> Iterator[tuple[int, bytes]]:
        """(ns, message) of each event, by time: one JSON object a message."""
        for event in sorted(self.record.execution.events, key=lambda e: e.t_s):
            ns = EPOCH_NS + max(0, round(event.t_s * 1e9))
            level = {"deadlock": 40, "collision": 40, "blocked": 30}.get(event.kind, 20)
            text = json.dumps(event_document(event, self.record.fleet, self.record.graph), ensure_ascii=False, allow_nan=False)
            name = self.robots[event.robot] if event.robot >= 0 else FLEET_NAME
            yield ns, self.serialised(self.make("rcl_interfaces/Log", self.time(ns), level, name, text, "", "", 0))

    # streams: message(k) is what is said at the k-th time of the samples

    def transforms(self, samples: Samples) -> "Stream":
        """/tf, all robots in one message."""
        frames = [f"{name}/base_link" for name in self.robots]

        def template(robots: IntArray) -> Template:
            def make(v: list[Any]) -> Any:
                rows = zip(robots, v[0::6], v[1::6], v[2::6], v[3::6], v[4::6], v[5::6])
                return self.make(
                    "tf2_msgs/TFMessage",
                    [
                        self.make(
                            "geometry_msgs/TransformStamped",
                            self.make("std_msgs/Header", self.make("builtin_interfaces/Time", sec, nanosec), "map"),
                            frames[r],
                            self.make("geometry_msgs/Transform", self.make("geometry_msgs/Vector3", x, y, 0.0), self.turn(qz, qw)),
                        )
                        for r, sec, nanosec, x, y, qz, qw in rows
                    ],
                )

            return Template(self.typestore, "tf2_msgs/msg/TFMessage", make, ("<i4", "<u4", "<f8", "<f8", "<f8", "<f8") * len(robots))

        def fill(t: Template, k: int, robots: Any) -> None:
            half = samples.yaw[k, robots] / 2
            t.set("<f8", np.stack((samples.x[k, robots], samples.y[k, robots], np.sin(half), np.cos(half)), 1).ravel())

        return Stream(samples, template, fill)

    def fleet_states(self, samples: Samples) -> "Stream":
        """/fleet_states of RMF."""
        mode = np.array([RMF_MODES[state] for state in range(len(STATE_NAMES))])
        tasks = [self.record.graph.label(int(v)) for v in self.record.target]
        more = ("",) if self.generation == "kilted" else ()  # performing_action

        def template(robots: IntArray) -> Template:
            def make(v: list[Any]) -> Any:
                rows = zip(robots, v[0::7], v[1::7], v[2::7], v[3::7], v[4::7], v[5::7], v[6::7])
                states = [
                    self.make(
                        "rmf_fleet_msgs/RobotState",
                        self.robots[r],
                        FLEET_NAME,
                        tasks[r],
                        number,
                        self.make("rmf_fleet_msgs/RobotMode", mode_now, 0, *more),
                        100.0,
                        self.location(0, x, y, yaw, t=self.make("builtin_interfaces/Time", sec, nanosec)),
                        [],
                    )
                    for r, number, mode_now, sec, nanosec, x, y, yaw in rows
                ]
                return self.make("rmf_fleet_msgs/FleetState", FLEET_NAME, states)

            kinds = ("<u8", "<u4", "<i4", "<u4", "<f4", "<f4", "<f4")
            return Template(self.typestore, "rmf_fleet_msgs/msg/FleetState", make, kinds * len(robots))

        def fill(t: Template, k: int, robots: Any) -> None:
            nanosec = int(samples.t_ns[k]) % 10**9
            now = mode[samples.state[k, robots]]
            t.set("<u8", k)
            t.set("<u4", np.stack((now, np.full(len(now), nanosec)), 1).ravel())
            t.set("<f4", np.stack((samples.x[k, robots], samples.y[k, robots], samples.yaw[k, robots]), 1).ravel())

        return Stream(samples, template, fill, nanosec=False)

    def cloud(self, samples: Samples) -> "Stream":
        """/robot_cloud: a point a robot, coloured by state."""
        fields = [("x", 7), ("y", 7), ("z", 7), ("rgb", 7), ("speed", 7), ("yaw", 7), ("id", 6), ("blocked", 2)]
        rgb = np.array([int("".join(f"{round(255 * c):02x}" for c in COLOURS[state]), 16) for state in range(len(STATE_NAMES))], np.uint32)

        def template(robots: IntArray) -> Template:
            described = [self.make("sensor_msgs/PointField", name, CLOUD.fields[name][1], kind, 1) for name, kind in fields]  # type: ignore[index]
            data = np.zeros(len(robots) * CLOUD.itemsize, np.uint8)

            def make(v: list[Any]) -> Any:
                header = self.make("std_msgs/Header", self.make("builtin_interfaces/Time", *v), "map")
                return self.make("sensor_msgs/PointCloud2", header, 1, len(robots), described, False, CLOUD.itemsize, len(data), data, True)

            return Template(self.typestore, "sensor_msgs/msg/PointCloud2", make, ("<i4", "<u4"))

        def fill(t: Template, k: int, robots: Any) -> None:
            state = samples.state[k, robots]
            points = np.zeros(len(state), CLOUD)
            points["x"], points["y"], points["yaw"] = samples.x[k, robots], samples.y[k, robots], samples.yaw[k, robots]
            points["speed"], points["rgb"], points["blocked"] = samples.speed[k, robots], rgb[state], state == BLOCKED
            points["id"] = np.arange(samples.x.shape[1])[robots]
            t.bytes_before_end(points.nbytes, after=1)[:] = points.view(np.uint8)

        return Stream(samples, template, fill)

    def odometry(self, samples: Samples, robot: int) -> "Stream":
        """/<robot>/odom of one robot; silent while it is not on the floor."""
        covariance = np.zeros(36)
        turn_rate = np.zeros(len(samples.t_ns))
        if len(turn_rate) > 1:
            turn = (np.diff(samples.yaw[:, robot]) + np.pi) % (2 * np.pi) - np.pi
            turn_rate[1:] = np.nan_to_num(turn / (np.diff(samples.t_ns) / 1e9))

        def template(_: IntArray) -> Template:
            def make(v: list[Any]) -> Any:
                header = self.make("std_msgs/Header", self.make("builtin_interfaces/Time", v[0], v[1]), "map")
                pose = self.make("geometry_msgs/Pose", self.make("geometry_msgs/Point", v[2], v[3], 0.0), self.turn(v[4], v[5]))
                twist = self.make("geometry_msgs/Twist", self.vector(v[6]), self.make("geometry_msgs/Vector3", 0.0, 0.0, v[7]))
                return self.make(
                    "nav_msgs/Odometry",
                    header,
                    f"{self.robots[robot]}/base_link",
                    self.make("geometry_msgs/PoseWithCovariance", pose, covariance),
                    self.make("geometry_msgs/TwistWithCovariance", twist, covariance),
                )

            return Template(self.typestore, "nav_msgs/msg/Odometry", make, ("<i4", "<u4") + ("<f8",) * 6)

        def fill(t: Template, k: int, _: Any) -> None:
            half = samples.yaw[k, robot] / 2
            now = samples.x[k, robot], samples.y[k, robot], math.sin(half), math.cos(half), samples.speed[k, robot], turn_rate[k]
            t.set("<f8", now)

        return Stream(samples, template, fill, only=robot)

    def diagnostics(self, samples: Samples, k: int) -> bytes:
        """/diagnostics: the state of each robot in words."""
        if not hasattr(self, "_statuses"):
            self._statuses = [[self._status(robot, state) for state in range(len(STATE_NAMES))] for robot in range(len(self.robots))]
        robots = np.flatnonzero(samples.there[k])
        sec, nanosec = divmod(EPOCH_NS + int(samples.t_ns[k]), 10**9)
        parts = bytearray(b"\x00\x01\x00\x00")  # CDR, little endian; then aligned to what follows these four
        parts += sec.to_bytes(4, "little") + nanosec.to_bytes(4, "little") + _string("") + bytes(-1 % 4)
        parts += len(robots).to_bytes(4, "little")
        for robot, state in zip(robots.tolist(), samples.state[k, robots].tolist()):
            parts.append(1 if state == BLOCKED else 0)  # level WARN or OK
            parts += bytes(-len(parts) % 4) + self._statuses[robot][state]
        return bytes(parts)

    def _status(self, robot: int, state: int) -> bytes:
        """A DiagnosticStatus after its level, from a multiple of four on."""
        values = (("state", STATE_NAMES[state]), ("goal", self.record.graph.label(int(self.record.target[robot]))))
        texts = [self.robots[robot], STATE_NAMES[state], self.record.fleet.robot_name[robot]]
        out = b"".join(_padded(_string(text)) for text in texts) + len(values).to_bytes(4, "little")
        pairs = [_string(text) for pair in values for text in pair]
        return out + b"".join(map(_padded, pairs[:-1])) + pairs[-1]

    def metrics(self, samples: Samples, k: int) -> dict[str, bytes]:
        """/metrics/*: figures of the fleet at a time."""
        there = samples.there[k]
        state, speed = samples.state[k, there], samples.speed[k, there]
        xy = np.column_stack((samples.x[k, there], samples.y[k, there]))
        figures = {
            "robots_moving": float((state == MOVING).sum()),
            "robots_waiting": float((state == WAITING).sum()),
            "robots_blocked": float((state == BLOCKED).sum()),
            "robots_at_goal": float((state == AT_GOAL).sum()),
            "mean_speed_mps": float(speed.mean()) if len(speed) else 0.0,
        }
        if len(xy) > 1:
            figures["min_distance_m"] = float(cKDTree(xy).query(xy, k=2)[0][:, 1].min())
        return {name: b"\x00\x01\x00\x00" + np.array(value, "<f8").tobytes() for name, value in figures.items()}


class Stream:
    """Messages over time from a template, made anew whenever other robots are on the floor."""

    def __init__(
        self,
        samples: Samples,
        template: Callable[[IntArray], Template],
        fill: Callable[[Template, int, Any], None],
        *,
        nanosec: bool = True,
        only: int | None = None,
    ) -> None:
        self.samples = samples
        self._make, self._fill, self._nanosec, self._only = template, fill, nanosec, only
        self._there: BoolArray | None = None
        self._template: Template | None = None
        self._robots: Any = slice(None)

    def message(self, k: int) -> bytes | None:
        """What is said at the k-th time; None for nothing."""
        there = self.samples.there[k]
        if self._only is not None and not there[self._only]:
            return None
        if self._template is None or (self._only is None and (there is not self._there and not np.array_equal(there, self._there))):  # type: ignore[arg-type]
            robots = np.flatnonzero(there)
            self._there, self._robots = there, slice(None) if there.all() else robots
            self._template = self._make(robots)
        sec, nanosec = divmod(EPOCH_NS + int(self.samples.t_ns[k]), 10**9)
        if there.any():
            self._template.set("<i4", sec)
            if self._nanosec:
                self._template.set("<u4", nanosec)
            self._fill(self._template, k, self._robots)
        return self._template.message()


def _string(text: str) -> bytes:
    """A CDR string: length with the final zero, bytes, zero."""
    raw = text.encode() + b"\x00"
    return len(raw).to_bytes(4, "little") + raw


def _padded(raw: bytes) -> bytes:
    return raw + bytes(-len(raw) % 4)


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
    """[N] heading towards the next point, at the end that of the last step."""
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
