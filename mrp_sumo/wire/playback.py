"""A run that viewers follow as if it were played back: they pause it, set its speed, and go back to what has been.

The thread that drives the run also says what viewers are to see. It drives on whenever their clock has reached the newest moment; as
long as it has not, it waits, or says once more what was. Viewers ask in threads of their own.
"""

import time
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from tempfile import SpooledTemporaryFile
from threading import Condition
from typing import NamedTuple

IN_MEMORY = 64_000_000  # bytes of messages, beyond which they are on the disk
MOST_BEHIND_S = 0.1  # of wall time; what is lost beyond is not made up for
BEAT_S = 0.02  # between two looks at the clock
LEAST_SPEED, MOST_SPEED = 0.01, 1000.0

Send = Callable[[str, int, bytes], None]  # topic, ns of the run, message


class Position(NamedTuple):
    """The viewers' place in a run."""

    now_ns: int
    playing: bool
    speed: float
    buffering: bool  # the run has yet to get there
    ended: bool


@dataclass
class MessageLog:
    """Messages, in the order in which they were said."""

    t_ns: list[int] = field(default_factory=list)  # ascending
    topics: list[str] = field(default_factory=list)
    ends: list[int] = field(default_factory=lambda: [0])  # in the file: message k lies from ends[k] to ends[k + 1]
    of_topic: dict[str, list[int]] = field(default_factory=dict)  # the messages of each
    file: "SpooledTemporaryFile[bytes]" = field(default_factory=lambda: SpooledTemporaryFile(max_size=IN_MEMORY))  # noqa: SIM115 it is closed with the playback

    def add(self, topic: str, t_ns: int, message: bytes) -> None:
        """Keep one more."""
        self.of_topic.setdefault(topic, []).append(len(self.t_ns))
        self.t_ns.append(t_ns)
        self.topics.append(topic)
        self.file.seek(self.ends[-1])
        self.file.write(message)
        self.ends.append(self.ends[-1] + len(message))

    def message(self, k: int) -> tuple[str, int, bytes]:
        """Topic, time and bytes of the k-th."""
        self.file.seek(self.ends[k])
        return self.topics[k], self.t_ns[k], self.file.read(self.ends[k + 1] - self.ends[k])

    def last_of_each(self, count: int) -> list[int]:
        """Of the first `count` messages those that came last on each topic, which are several where they came at one time."""
        last = []
        for places in self.of_topic.values():
            k = bisect_right(places, count - 1)
            if k:
                last += places[bisect_left(places, self.t_ns[places[k - 1]], hi=k, key=self.t_ns.__getitem__) : k]
        return sorted(last)


class Playback:
    """The messages of a run so far, and the viewers' place in it."""

    def __init__(self, send: Send, tick: Callable[[Position], None], speed: float = 1.0) -> None:
        """`tick` is called when viewers have got further; `speed`: simulated seconds a second."""
        self._send, self._tick = send, tick
        self._changed = Condition()
        self._kept = MessageLog()
        self._sent = 0  # messages that viewers have, counted from the beginning
        self._newest_ns = 0
        self._at_ns, self._since = 0.0, time.monotonic()  # where viewers were, and when
        self._speed, self._playing = speed, True
        self._to_ns: int | None = None  # where viewers have asked to be
        self._listening: set[tuple[int, str]] = set()  # viewers, and topics
        self._wanted: set[str] = set()  # topics that somebody has just begun to listen to
        self._ended = False

    def control(self, playing: bool, speed: float, to_ns: int | None) -> Position:
        """Do what a viewer asks for. Times beyond what was driven are reached as fast as the run can be driven."""
        with self._changed:
            wall_s = time.monotonic()
            self._at_ns, self._since = self._now_ns(wall_s), wall_s
            self._playing = playing
            if LEAST_SPEED <= speed <= MOST_SPEED:
                self._speed = speed
            if to_ns is not None:
                self._to_ns = min(max(0, to_ns), self._newest_ns) if self._ended else max(0, to_ns)
            self._changed.notify_all()
            return self._position(self._at_ns)

    def listens(self, viewer: int, topic: str) -> None:
        """Somebody has begun to listen to a topic: what was last said there is said again."""
        with self._changed:
            self._listening.add((viewer, topic))
            self._wanted.add(topic)
            self._changed.notify_all()

    def leaves(self, viewer: int, topic: str) -> None:
        """Somebody listens to a topic no longer. With nobody left the run goes on."""
        with self._changed:
            self._listening.discard((viewer, topic))
            if not self._listening:
                self._at_ns, self._since, self._playing, self._to_ns = self._newest_ns, time.monotonic(), True, None
            self._changed.notify_all()

    def add(self, messages: Iterable[tuple[str, bytes]], now_ns: int) -> None:
        """Say what is new at a moment of the run. Returns when the run is to go on."""
        for topic, message in messages:
            self._kept.add(topic, now_ns, message)
        with self._changed:
            self._newest_ns = now_ns
        while not self._catch_up():
            self._wait()

    def finish(self) -> None:
        """Nothing more comes. Returns when viewers have seen all of it, or have left."""
        with self._changed:
            self._ended = True
            self._to_ns = None if self._to_ns is None else min(self._to_ns, self._newest_ns)
        while not (self._catch_up() and self._playing):
            self._wait()
        with self._changed:
            position = self._position(self._now_ns(time.monotonic()))
        self._tick(position)

    def close(self) -> None:
        """Forget what was said."""
        self._kept.file.close()

    def _catch_up(self) -> bool:
        """Say what is due; whether viewers are at the newest moment, or want to be beyond it."""
        with self._changed:
            again: list[int] = []
            wall_s = time.monotonic()  # read once: at a thousand times the speed the run goes on by seconds between two looks
            if self._to_ns is not None:
                if self._to_ns > self._newest_ns:
                    return True
                self._at_ns, self._since = self._to_ns, wall_s
            now_ns = self._now_ns(wall_s)
            due = bisect_right(self._kept.t_ns, now_ns)
            if self._to_ns is not None:
                again, self._sent, self._to_ns = self._kept.last_of_each(due), due, None
            elif self._wanted:
                again = [k for k in self._kept.last_of_each(self._sent) if self._kept.topics[k] in self._wanted]
            self._wanted.clear()
            new = range(self._sent, due)
            self._sent = due
            if there := now_ns >= self._newest_ns:
                spare_ns = 0.0 if self._ended else 1e9 * MOST_BEHIND_S * self._speed
                self._at_ns, self._since = min(now_ns, self._newest_ns + spare_ns), wall_s
            position = self._position(now_ns)
        for k in again:
            topic, t_ns, message = self._kept.message(k)
            self._send(topic, max(t_ns, position.now_ns), message)  # to viewers time does not go back once more
        for k in new:
            self._send(*self._kept.message(k))
        if again or new:
            self._tick(position)
        return there

    def _wait(self) -> None:
        with self._changed:
            left_s = max(0.0, self._newest_ns - self._now_ns(time.monotonic())) / 1e9 / self._speed
            self._changed.wait(min(BEAT_S, left_s) if self._playing and left_s else BEAT_S)

    def _now_ns(self, wall_s: float) -> float:
        """Where viewers are when the clock shows `wall_s`."""
        return self._at_ns + (1e9 * self._speed * (wall_s - self._since) if self._playing else 0.0)

    def _position(self, now_ns: float) -> Position:
        buffering = self._to_ns is not None and self._to_ns > self._newest_ns
        now_ns = min(now_ns, self._newest_ns) if self._to_ns is None else self._to_ns
        return Position(round(now_ns), self._playing, self._speed, buffering, self._ended and now_ns >= self._newest_ns)
