"""The files of a bag: one, or one part after the other as `ros2 bag record --max-bag-duration` makes them.

Every part is a bag that opens by itself; `metadata.yaml` lists all of them, so that readers take the folder as one bag.
"""

import shutil
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from types import FunctionType, TracebackType
from typing import Any, Literal, Self

import yaml
from rosbags.interfaces import Connection, Qos
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.metadata import dump_qos_v8

VERSION: Literal[8] = 8
STORAGES = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}
ABOUT = "rosbag2_bagfile_information"


@cache
def _profiles_text(profiles: tuple[Qos, ...]) -> str:
    return dump_qos_v8(list(profiles))


def _with_stored_profiles(method: Callable[..., Any]) -> Any:
    """A method of the library's writer that makes the text of each kind of profile once.

    The library makes it twice for each topic, which takes longer than a short run's messages. Its own module stays as it is.
    """
    seen_by_it = {**method.__globals__, "dump_qos_v8": lambda qos: _profiles_text(tuple(qos))}
    same = FunctionType(method.__code__, seen_by_it, method.__name__)
    same.__kwdefaults__ = method.__kwdefaults__
    return same


class FastWriter(Writer):
    """The library's writer without its search for the connection, which is linear in the number of topics."""

    add_connection = _with_stored_profiles(Writer.add_connection)
    close = _with_stored_profiles(Writer.close)

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        assert self.storage is not None
        self.storage.write(connection, timestamp, data)
        self.counts[connection.id] += 1
        if timestamp < self.min_timestamp:
            self.min_timestamp = timestamp
        if timestamp > self.max_timestamp:
            self.max_timestamp = timestamp


class PartedWriter:
    """Writes a bag in one file, or a new one whenever `next_part` is called."""

    def __init__(self, folder: Path, storage: str, about: Mapping[str, str], *, parted: bool) -> None:
        self._folder, self._storage, self._about = folder, storage, about
        self._parts: list[Path] | None = [] if parted else None  # folders of the parts so far
        self._connections: list[dict[str, Any]] = []
        self._writer = self._opened()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self._writer.__exit__(kind, error, traceback)
        if kind is None and self._parts is not None:
            _join(self._folder, self._parts)

    def add_connection(self, topic: str, kind: str, **about: Any) -> Connection:
        """Add a topic, also to the parts that come later."""
        self._connections.append({"topic": topic, "msgtype": kind, **about})
        connection: Connection = self._writer.add_connection(**self._connections[-1])
        return connection

    def write(self, connection: Connection, ns: int, data: bytes | memoryview) -> None:
        self._writer.write(connection, ns, data)

    def next_part(self) -> None:
        """Go on in another file; topics keep their numbers."""
        self._writer.close()
        self._writer = self._opened()
        for connection in self._connections:
            self._writer.add_connection(**connection)

    def _opened(self) -> FastWriter:
        folder = self._folder
        if self._parts is not None:
            folder.mkdir(exist_ok=True)
            folder = folder / f"{folder.name}_{len(self._parts)}"
            self._parts.append(folder)
        writer = FastWriter(folder, version=VERSION, storage_plugin=STORAGES[self._storage])
        if self._storage == "mcap":
            writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        for key, value in self._about.items():
            writer.set_custom_data(key, value)
        writer.open()
        return writer


def _join(folder: Path, parts: list[Path]) -> None:
    """Make one bag of bags that follow each other and have the same topics."""
    documents = [yaml.safe_load((part / "metadata.yaml").read_text(encoding="utf-8"))[ABOUT] for part in parts]
    whole, last = documents[0], documents[-1]
    begin, end = (about["starting_time"]["nanoseconds_since_epoch"] for about in (whole, last))
    whole["relative_file_paths"] = [name for about in documents for name in about["relative_file_paths"]]
    whole["files"] = [file for about in documents for file in about["files"]]
    whole["duration"]["nanoseconds"] = end + last["duration"]["nanoseconds"] - begin
    whole["message_count"] = sum(about["message_count"] for about in documents)
    for k, topic in enumerate(whole["topics_with_message_count"]):
        topic["message_count"] = sum(about["topics_with_message_count"][k]["message_count"] for about in documents)
    for part, about in zip(parts, documents):
        (part / about["relative_file_paths"][0]).rename(folder / about["relative_file_paths"][0])
        shutil.rmtree(part)
    text = yaml.safe_dump({ABOUT: whole}, sort_keys=False, allow_unicode=True)
    (folder / "metadata.yaml").write_text(text, encoding="utf-8")
