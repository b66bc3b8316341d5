"""Messages between a run and its viewers: shared by the thread that drives and those that serve."""

import json
import time
from collections.abc import Callable, Iterator
from threading import Condition
from typing import Any

PATIENCE_S = 2.0  # for viewers to take the last of it
BEAT_S = 0.04  # between two parts of a viewer's stream


class Broadcast:
    """Samples of equal size, messages, and a clock that viewers stop, start and set.

    Everything sent so far is kept, so that those who join late, or again, see it all.
    """

    def __init__(self) -> None:
        self._changed = Condition()
        self._samples = bytearray()
        self._sample_bytes = 1
        self._messages: list[str] = []
        self._last = ""  # message, after all samples
        self._over = False
        self._viewers = 0
        self._paused = False
        self._steps = 0  # samples that may still pass while paused
        self._speed: float | None = 1.0  # simulated seconds a second, None: as fast as it goes
        self._due = 0.0  # wall time of the next sample
        self.intervene: Callable[[dict[str, Any]], str] | None = None  # with the run itself; returns why not

    # what the run says

    def begin(self, sample_bytes: int) -> None:
        """Say how large a sample is."""
        self._sample_bytes = sample_bytes

    def say(self, name: str, value: Any) -> None:
        """Add a message."""
        with self._changed:
            self._messages.append(_event(name, value))

    def say_last(self, value: Any) -> None:
        """Have the message `end`, which viewers get when they have all samples and other messages."""
        self._last = _event("end", value)

    def sample(self, data: bytes, lasts_s: float) -> None:
        """Add a sample, and wait until it is time for the next, `lasts_s` of simulated time later."""
        with self._changed:
            self._samples += data
            if self._speed is not None:
                # what came late is not made up for by more than a tenth of a second
                self._due = max(self._due, time.monotonic() - 0.1) + lasts_s / self._speed
            while True:
                if self._paused and self._viewers and self._steps == 0:
                    self._changed.wait(0.25)
                    self._due = time.monotonic()
                    continue
                left = self._due - time.monotonic() if self._speed is not None else 0.0
                if left <= 0:
                    break
                self._changed.wait(min(left, 0.25))
            self._steps = max(0, self._steps - 1)

    def end(self) -> None:
        """Nothing more comes. Returns when viewers have taken everything, or soon."""
        with self._changed:
            self._over = True
            self._changed.notify_all()
            until = time.monotonic() + PATIENCE_S
            while self._viewers and time.monotonic() < until:
                self._changed.wait(0.1)

    # what viewers say

    def control(self, order: dict[str, Any]) -> str:
        """Do what a viewer asks for. Returns why not, '' if it was done."""
        if isinstance(order, dict) and order.get("do") in ("break", "close", "add") and self.intervene:
            return "the run is over" if self._over else self.intervene(order)
        with self._changed:
            match order:
                case {"do": "play"}:
                    self._paused, self._steps = False, 0
                case {"do": "pause"}:
                    self._paused, self._steps = True, 0
                case {"do": "step"}:
                    self._paused, self._steps = True, self._steps + 1
                case {"do": "speed", "speed": None}:
                    self._speed = None
                case {"do": "speed", "speed": int() | float() as speed} if 0.01 <= speed <= 1000:
                    self._speed, self._due = float(speed), time.monotonic()
                case _:
                    return "expected play, pause, step, or speed with a number from 0.01 to 1000 or null"
            self._messages.append(f"event: clock\ndata: {json.dumps({'paused': self._paused, 'speed': self._speed})}\n\n")
            self._changed.notify_all()
        return ""

    def stream(self) -> Iterator[tuple[str, bytes]]:
        """All that was said and will be said, for one viewer: messages as text, and samples as (`''`, bytes); ends with the run."""
        said = seen = 0
        with self._changed:
            self._viewers += 1
        try:
            while True:
                with self._changed:
                    messages, over = self._messages[said:], self._over
                    samples = bytes(self._samples[seen : seen + 4000 * self._sample_bytes])
                said, seen = said + len(messages), seen + len(samples)
                for message in messages:
                    yield message, b""
                if samples:
                    yield "", samples
                elif over:
                    if self._last:
                        yield self._last, b""
                    return
                else:
                    yield ":\n\n", b""  # finds out whether anybody is still there
                time.sleep(BEAT_S)
        finally:
            with self._changed:
                self._viewers -= 1
                self._changed.notify_all()


def _event(name: str, value: Any) -> str:
    return f"event: {name}\ndata: {json.dumps(value, allow_nan=False, separators=(',', ':'))}\n\n"
