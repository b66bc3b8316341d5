"""Fleet states from any bag: ROS 2 (mcap, sqlite3) or ROS 1, any generation of rmf_fleet_msgs.

Message definitions in the bag are used where there are any; otherwise the generation is the one that encodes the
messages back to the same bytes. Refuses bags without the topic, and damaged ones, in one line.
"""

import resource
import sqlite3
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from rosbags.highlevel import AnyReader

from mrp_sumo.bags.messages import GENERATIONS, typestore
from mrp_sumo.bags.paths import plain_path
from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.errors import MrpSumoError, first_line, nearest
from mrp_sumo.files.names import fault_of
from mrp_sumo.files.reading import require_regular

FLEET_STATES = "/fleet_states"
PATH_REQUESTS = "/robot_path_requests"
MAX_BYTES = 2**40  # of a bag, which is read message by message
LEAST_BYTES, TIMES_SIZE = 2**30, 128  # of memory to read a bag, beside what the program has; messages are large as Python has them
CHECKED = 20  # messages that are encoded again to recognise the generation
EMPTY_BYTES = 100  # a fleet without robots looks the same in all of them
Place = tuple[float, float]
Message = tuple[str, int, Any]
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class FleetLog:
    """T fleet states of R robots. NaN where a robot is not in a message."""

    t_ns: IntArray  # [T] stamps of the bag
    robot_name: tuple[str, ...]  # [R] in order of appearance
    x_m: FloatArray  # [T, R]
    y_m: FloatArray  # [T, R]
    requests: dict[str, tuple[Place, Place]]  # start and goal of each robot's first path request


def read_fleet_log(path: Path, generation: str | None = None) -> FleetLog:
    """Read `/fleet_states`, and starts and goals from `/robot_path_requests` if there are any.

    A bag is a folder with metadata.yaml, an .mcap or .db3 file, or a ROS 1 .bag. The generation of rmf_fleet_msgs is for bags without
    definitions, and detected by default. Raises MrpSumoError when the bag cannot be read, has no fleet states, or no generation fits.
    """
    wanted = (FLEET_STATES, PATH_REQUESTS)
    return read_bag(path, lambda messages: _fleet_log(path, list(messages)), lambda topic, kind: topic in wanted, FLEET_STATES, generation)


def read_bag(
    path: Path,
    use: Callable[[Iterator[Message]], T],
    is_wanted: Callable[[str, str], bool],
    needed: str = "",
    generation: str | None = None,
) -> T:
    """The result of `use` of the messages of a bag: topic, stamp of the bag in ns, message.

    `use` may be called again, with other definitions; `is_wanted` says whether a topic and a type are to be read, and without the topic
    `needed` a bag is refused. Path, generation and errors are those of `read_fleet_log`.
    """
    known = (generation,) if generation else GENERATIONS
    typestore(known[0])  # refuses an unknown one
    if not path.exists():
        raise MrpSumoError(f"{path}: no such bag")
    for file in sorted(path.iterdir()) if path.is_dir() else (path,):
        if not file.is_dir():
            require_regular(file, MAX_BYTES)
    reasons = []
    for name in known:
        try:
            with _bounded_memory(path):
                return use(_messages(path, name, is_wanted, needed))
        except _WrongGeneration as error:
            reasons.append(f"{name}: {error}")
        except MrpSumoError:
            raise
        except MemoryError:
            raise MrpSumoError(f"{path}: takes more memory than a bag of {_size_bytes(path) / 1e6:.1f} MB may: damaged") from None
        except Exception as error:  # a damaged bag: whatever the reader stumbles over
            raise MrpSumoError(f"{path}: cannot be read as a bag: {type(error).__name__}: {first_line(error)[:120]}") from None
    raise MrpSumoError(f"{path}: {needed or 'what is in it'} fits no generation of rmf_fleet_msgs ({'; '.join(reasons)})")


def _size_bytes(path: Path) -> int:
    return sum(file.stat().st_size for file in (path.iterdir() if path.is_dir() else (path,)) if file.is_file())


@contextmanager
def _bounded_memory(path: Path) -> Iterator[None]:
    """Have the system refuse what a bag of this size does not take: a compressed chunk may say little of what is in it."""
    used = Path("/proc/self/statm")  # on Linux
    if not used.exists():
        yield
        return
    before, hard = resource.getrlimit(resource.RLIMIT_AS)
    limit = int(used.read_text().split()[0]) * resource.getpagesize() + LEAST_BYTES + TIMES_SIZE * _size_bytes(path)
    resource.setrlimit(resource.RLIMIT_AS, (min(limit, *(each for each in (before, hard) if each != resource.RLIM_INFINITY), limit), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (before, hard))


class _WrongGeneration(Exception):
    """Messages do not decode with these definitions."""


def _messages(path: Path, generation: str, is_wanted: Callable[[str, str], bool], needed: str) -> Iterator[Message]:
    store = typestore(generation)
    alone = _lone_database(path)
    if alone is not None:
        yield from _database_messages(alone, store, is_wanted, needed)
        return
    bag = path.parent if path.suffix in (".mcap", ".db3") and (path.parent / "metadata.yaml").is_file() else path
    if bag.is_dir() and not (bag / "metadata.yaml").is_file():
        raise MrpSumoError(f"{bag}: no metadata.yaml: not a bag, or its writer was interrupted (`ros2 bag reindex` may help)")
    if bag.is_file() and bag.suffix != ".bag":
        raise MrpSumoError(f"{bag}: expected the bag's folder, with its metadata.yaml")
    with plain_path(bag) as place, AnyReader([place], default_typestore=store) as reader:
        _require_topic(path, [c.topic for c in reader.connections], needed)
        decoded = _decoder(reader.typestore)
        wanted = [c for c in reader.connections if is_wanted(c.topic, c.msgtype)]
        for connection, ns, raw in reader.messages(wanted) if wanted else ():  # none would be all
            if reader.is2:
                yield connection.topic, ns, decoded(connection.msgtype, bytes(raw))
            else:
                yield connection.topic, ns, reader.deserialize(raw, connection.msgtype)


def _lone_database(path: Path) -> Path | None:
    """The only .db3 file of a bag without metadata, which MRP-Bench's analyser opens as well."""
    if path.is_file() and path.suffix == ".db3":
        return path if not (path.parent / "metadata.yaml").is_file() else None
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        files = [file for file in sorted(path.glob("*.db3")) if file.stat().st_size]
        return files[0] if len(files) == 1 else None
    return None


def _database_messages(path: Path, store: Any, is_wanted: Callable[[str, str], bool], needed: str) -> Iterator[Message]:
    with closing(sqlite3.connect(path.resolve().as_uri() + "?mode=ro", uri=True)) as database:
        decoded = _decoder(store)
        topics = {number: (name, kind) for number, name, kind in database.execute("select id, name, type from topics")}
        _require_topic(path, [name for name, _ in topics.values()], needed)
        for number, ns, raw in database.execute("select topic_id, timestamp, data from messages order by timestamp, id"):
            name, kind = topics[number]
            if is_wanted(name, kind):
                yield name, ns, decoded(kind, raw)


def _decoder(store: Any) -> Callable[[str, bytes], Any]:
    """Decodes messages. The first ones are encoded again: a wrong definition rarely gives the same length."""
    left = CHECKED

    def decoded(kind: str, raw: bytes) -> Any:
        nonlocal left
        try:
            message = store.deserialize_cdr(raw, kind)
            again = len(store.serialize_cdr(message, kind)) if left else len(raw)
        except Exception as error:  # garbage lengths raise anything
            raise _WrongGeneration(f"{type(error).__name__} {first_line(error)[:120]}".strip()) from None
        if again + 3 < len(raw) or again > len(raw):  # writers may pad to four bytes
            raise _WrongGeneration("decodes to another length")
        if len(raw) > EMPTY_BYTES:
            left = max(0, left - 1)
        return message

    return decoded


def _fleet_log(path: Path, messages: list[Message]) -> FleetLog:
    states = [(ns, message.robots) for topic, ns, message in messages if topic == FLEET_STATES]
    if not states:
        raise MrpSumoError(f"{path}: {FLEET_STATES} has no message")
    names = {robot.name: None for _, robots in states for robot in robots}
    if fault := next(filter(None, map(fault_of, names)), ""):
        raise MrpSumoError(f"{path}: {FLEET_STATES}: name of a robot: {fault}")
    column = {name: r for r, name in enumerate(names)}
    x, y = np.full((2, len(states), len(column)), np.nan)
    for k, (_, robots) in enumerate(states):
        for robot in robots:
            x[k, column[robot.name]], y[k, column[robot.name]] = robot.location.x, robot.location.y
    requests: dict[str, tuple[Place, Place]] = {}
    for topic, _, message in messages:
        if topic == PATH_REQUESTS and len(message.path) and message.robot_name not in requests:
            a, b = message.path[0], message.path[-1]
            requests[message.robot_name] = (float(a.x), float(a.y)), (float(b.x), float(b.y))
    return FleetLog(np.array([ns for ns, _ in states], np.int64), tuple(column), x, y, requests)


def _require_topic(path: Path, topics: Iterable[str], needed: str) -> None:
    topics = sorted(set(topics))
    if needed and needed not in topics:
        raise MrpSumoError(f"{path}: no topic {needed}{nearest(needed, topics)}")
