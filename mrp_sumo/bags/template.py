"""Fast CDR: a message of fixed layout is serialised once, and copies of it differ in their numbers only.

The layout of a message does not change while its strings and array lengths stay the same. A template
has the library serialise one with random numbers, finds where they went, and remembers the places. The
bytes are the library's own; tests compare them for every type written.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

HEADER = 4  # bytes before the body; CDR aligns from the end of them


class Template:
    """A serialised message, of which many can be made whose numbers are set by kind, in the order in which `make` takes them.

    `make` builds a message of a list of numbers, whose dtypes are `kinds`: <f8, <f4, <i4, <u4 or <u8. Raises RuntimeError when a number
    is not found exactly once in the message; that is a mistake in `make` or `kinds`.
    """

    def __init__(self, typestore: Any, make: Callable[[list[Any]], Any], kinds: Sequence[str]) -> None:
        kind_of = np.asarray(kinds)
        if not any(self._located(typestore, make, kind_of, seed) for seed in range(20)):
            raise RuntimeError("a number does not occur exactly once in the message")

    def _located(self, typestore: Any, make: Callable[[list[Any]], Any], kind_of: NDArray[np.str_], seed: int) -> bool:
        """Try with one set of random numbers; False when they are ambiguous."""
        rng = np.random.default_rng(seed)
        marks = np.empty(len(kind_of), object)
        for kind in np.unique(kind_of):
            count = int((kind_of == kind).sum())
            drawn = rng.uniform(1e6, 9e6, count) if kind[1] == "f" else rng.integers(2**20, 2**31 - 1, count)
            marks[kind_of == kind] = list(drawn.astype(kind))
        message = make(list(marks))
        raw = bytes(typestore.serialize_cdr(message, message.__msgtype__))
        self.size = len(raw)
        # the body begins at byte 8 here, so that views of 8-byte numbers are aligned as CDR aligns them
        self._buffer = np.zeros(2 * HEADER + -(-self.size // 8) * 8, np.uint8)
        self._buffer[HEADER : HEADER + self.size] = np.frombuffer(raw, np.uint8)
        body = self._buffer[2 * HEADER :]
        self._index: dict[str, Any] = {}
        for kind in np.unique(kind_of):
            size = np.dtype(kind).itemsize
            view, wanted = body[: len(body) // size * size].view(kind), np.array(list(marks[kind_of == kind]), kind)
            order = np.argsort(view, kind="stable")
            at = order[np.minimum(np.searchsorted(view[order], wanted), len(view) - 1)]
            if (view[at] != wanted).any() or np.isin(view, wanted).sum() != len(wanted):
                return False
            step = np.diff(at)
            regular = len(at) > 1 and step[0] > 0 and (step == step[0]).all()
            self._index[str(kind)] = slice(int(at[0]), int(at[-1]) + 1, int(step[0])) if regular else at
        return True

    def copies(self, count: int) -> "Copies":
        """As many messages, whose numbers are to be set."""
        return Copies(np.tile(self._buffer, (count, 1)), self._index, self.size)


class Copies:
    """K serialised messages of one layout, [K, B] bytes."""

    def __init__(self, rows: NDArray[np.uint8], index: Mapping[str, Any], size: int) -> None:
        self._rows, self._index, self.size = rows, index, size

    def __len__(self) -> int:
        return len(self._rows)

    def set(self, kind: str, values: NDArray[Any]) -> None:
        """Set all numbers of a kind, in order: [K, N], or [K, 1] for one value a message. Messages may have none."""
        if kind in self._index:
            view = self._rows.view(kind)
            view[:, 2 * HEADER // view.itemsize :][:, self._index[kind]] = values

    def message(self, k: int) -> bytes:
        """The k-th serialised message."""
        return self._rows[k, HEADER : HEADER + self.size].tobytes()

    def set_before_end(self, values: NDArray[np.uint8], after: int) -> None:
        """Overwrite a payload [K, N] that is followed by the last `after` bytes."""
        end = HEADER + self.size - after
        self._rows[:, end - values.shape[1] : end] = values


MARKS = (0x51A2B3C1, 0x52A3B4C2, 0x53A4B5C3)


def tiled(serialised: Callable[[Sequence[int]], bytes], count: int) -> tuple[NDArray[np.uint8], int, int, int]:
    """The bytes of a message whose one sequence of records is `count` long, at least 1, and where its records begin.

    `serialised` makes the message with one record for each number given, which the record begins with; it ends on a multiple of eight
    bytes. Records begin at the three numbers that are returned: `first`, `second`, `second + stride`, ...; all but the first hold the
    second's values.
    """
    raw = serialised(MARKS)
    places = [raw.find(mark.to_bytes(4, "little")) for mark in MARKS]
    if min(places) < 0 or any(raw.count(mark.to_bytes(4, "little")) != 1 for mark in MARKS):
        raise RuntimeError("a mark does not occur exactly once in the message")
    first, second, third = places
    stride = third - second
    message = bytearray(raw[:second] + raw[second:third] * (count - 1) + raw[third + stride :])
    message[first - 4 : first] = count.to_bytes(4, "little")
    return np.frombuffer(message, np.uint8), first, second, stride
