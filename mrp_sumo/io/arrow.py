"""Arrow columns of arrays and texts, as `pyarrow.array` makes them, but without its import of pandas; and tables of them in files."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from mrp_sumo.core.graph import BoolArray

KEY = b"mrp_sumo"  # of the document in a table's metadata


def numbers(values: np.ndarray, there: BoolArray | None = None) -> pa.Array:
    """An Arrow array that shares the memory of numbers [N], or copies truth values; null where a value is not `there` [N].

    `pa.array` would load pandas first.
    """
    data = _bits(values) if values.dtype == np.bool_ else pa.py_buffer(np.ascontiguousarray(values))
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), [None if there is None else _bits(there), data])


def _bits(flags: BoolArray) -> pa.Buffer:
    return pa.py_buffer(np.packbits(flags, bitorder="little"))


def texts(values: Iterable[str | None]) -> pa.StringArray:
    """An Arrow array of texts; None is null."""
    encoded = [None if value is None else value.encode() for value in values]
    ends = np.cumsum([0, *(len(value or b"") for value in encoded)], dtype=np.int32)
    bits = _bits(np.array([value is not None for value in encoded], np.bool_)) if None in encoded else None
    return pa.StringArray.from_buffers(len(encoded), pa.py_buffer(ends), pa.py_buffer(b"".join(filter(None, encoded))), bits)


def dictionary(values: Sequence[str]) -> pa.DictionaryArray:
    """An Arrow array of texts that keeps each text once, in the order in which they come first."""
    index = {value: k for k, value in enumerate(dict.fromkeys(values))}
    return pa.DictionaryArray.from_arrays(numbers(np.array([index[value] for value in values], np.int32)), texts(index))


def write_table(path: Path, columns: Mapping[str, pa.Array], about: Any = None) -> None:
    """Write a table, with a document in its metadata."""
    table = pa.table(dict(columns))
    pq.write_table(table.replace_schema_metadata({KEY: json.dumps(about)}) if about else table, path, compression="zstd")
