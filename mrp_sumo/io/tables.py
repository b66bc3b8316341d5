"""Parquet tables of folders that may be anybody's: a column is there, of its type and in its range, or one line says what is not.

A table is refused before it is read where it would take much more memory than its file. Texts are kept once each, however often they
come, so that rows cannot multiply them. Rows are counted from 0 in messages.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, frozen
from mrp_sumo.errors import MrpSumoError, first_line, nearest
from mrp_sumo.files.reading import MAX_BYTES, json_value, require_regular, shortened
from mrp_sumo.io.arrow import KEY

MIN_BYTES_REFUSED = 2**31  # in memory; tables below may be as much larger than their files as they like
MAX_RATIO = 100  # of memory to file, of larger ones; trajectories of moving robots have 5, of parked ones 50
VALUE_BYTES = 8
MOST = 1e100  # of numbers, which are squared and added up
DAMAGE = (pa.ArrowException, OSError, ValueError, KeyError, NotImplementedError, RecursionError)

Names = Mapping[str, int] | Sequence[str]


def read_table(path: Path, *, max_bytes: int = MAX_BYTES, error: type[MrpSumoError] = MrpSumoError) -> "Table":
    """The table in a file. Raises MrpSumoError for what is no Parquet file, and one that would take much more memory than its bytes."""
    require_regular(path, max_bytes, error)
    try:
        about, schema = pq.read_metadata(path), pq.read_schema(path)
        columns = [about.schema.column(k) for k in range(about.num_columns)]
        texts = [column.path for column in columns if column.physical_type == "BYTE_ARRAY"]
        with pq.ParquetFile(path, metadata=about, read_dictionary=texts) as file:
            chunks = [about.row_group(g).column(c) for g in range(about.num_row_groups) for c in range(about.num_columns)]
            needs = about.num_rows * about.num_columns * VALUE_BYTES + sum(chunk.total_uncompressed_size for chunk in chunks)
            if needs > max(MIN_BYTES_REFUSED, MAX_RATIO * path.stat().st_size):
                raise error(f"{shortened(path)}: {about.num_rows} rows would take {needs / 2**30:.0f} GB, which is not read")
            if twice := {name for name in schema.names if schema.names.count(name) > 1}:
                raise error(f"{shortened(path)}: two columns '{min(twice)[:40]}'")
            return Table(path, file.read(), schema, error)
    except DAMAGE as fault:
        raise error(f"{shortened(path)}: not a readable Parquet file: {first_line(fault)}") from None


@dataclass(frozen=True, eq=False)
class Table:
    """A table of N rows. What a column is asked for and does not hold is an MrpSumoError of one line."""

    path: Path
    content: pa.Table  # texts as dictionaries
    schema: pa.Schema  # as it is in the file
    error: type[MrpSumoError]

    @property
    def num_rows(self) -> int:
        return int(self.content.num_rows)

    def as_written(self) -> pa.Table:
        """The whole table, its columns of the types that they have in the file, whatever its metadata say of them."""
        needs = 0
        for column in self.content.columns:
            if pa.types.is_dictionary(column.type) and column.num_chunks and pa.types.is_string(column.type.value_type):
                for chunk in column.chunks:
                    sizes = np.array([len(text or "") for text in chunk.dictionary.to_pylist()] or [0], np.int64)
                    needs += int(sizes[chunk.indices.fill_null(0).to_numpy(zero_copy_only=False)].sum())
        if needs > MIN_BYTES_REFUSED:
            raise self.fault(f"its texts would take {needs / 2**30:.0f} GB, which is not read")
        return self.content.cast(self.schema).replace_schema_metadata(None)

    def has(self, name: str) -> bool:
        """True if there is such a column."""
        return name in self.content.column_names

    def numbers(self, name: str, missing: float | None = None) -> FloatArray:
        """[N] numbers; `missing` where there is none, if that may be."""
        column = self._column(name)
        if not (pa.types.is_integer(column.type) or pa.types.is_floating(column.type)):
            raise self._fault_of_type(name, column, "numbers")
        values: FloatArray = column.to_numpy(zero_copy_only=False).astype(np.float64)
        null = self._null(name, column, missing is not None)
        if (odd := ~(np.abs(values) < MOST) & ~null).any():
            value, below = values[odd][0], f" below {MOST:g}" if np.isfinite(values[odd][0]) else ""
            raise self._fault_at(name, int(np.argmax(odd)), f"found {value}, expected a number{below}")
        values[null] = np.nan if missing is None else missing
        return frozen(values)

    def integers(self, name: str, least: int = -(2**62), most: int = 2**62) -> IntArray:
        """[N] whole numbers in a range."""
        column = self._column(name)
        if not pa.types.is_integer(column.type):
            raise self._fault_of_type(name, column, "whole numbers")
        self._null(name, column, False)
        values = column.to_numpy(zero_copy_only=False)
        if values.dtype == np.uint64:
            least = max(0, least)
        if (odd := (values < least) | (values > most)).any():
            bounds = f"{least} or more" if most == 2**62 else f"{least} to {most}"
            raise self._fault_at(name, int(np.argmax(odd)), f"found {int(values[odd][0])}, expected {bounds}")
        return frozen(values.astype(np.int64))

    def times(self, name: str) -> FloatArray:
        """[N] seconds, in order."""
        values = self.numbers(name)
        if (odd := np.diff(values) < 0).any():
            row = int(np.argmax(odd)) + 1
            raise self._fault_at(name, row, f"found {values[row]}, expected {values[row - 1]} or more")
        return values

    def flags(self, name: str) -> BoolArray:
        """[N] true or false."""
        column = self._column(name)
        if not pa.types.is_boolean(column.type):
            raise self._fault_of_type(name, column, "true or false")
        self._null(name, column, False)
        return frozen(column.to_numpy(zero_copy_only=False).astype(np.bool_))

    def texts(self, name: str) -> tuple[str, ...]:
        """[N] texts."""
        listed, at = self._coded(name)
        self._null(name, self._column(name), False)
        return tuple([listed[k] for k in at.tolist()])

    def indices(self, name: str, names: Names, missing: int | None = None) -> IntArray:
        """[N] which of `names`, by their order or their numbers, each row has; `missing` where there is none, if that may be."""
        number = names if isinstance(names, Mapping) else {text: k for k, text in enumerate(names)}
        listed, at = self._coded(name)
        null = self._null(name, self._column(name), missing is not None)
        unknown = np.array([text not in number for text in listed], np.bool_)
        if len(listed) and (odd := unknown[at] & ~null).any():
            row = int(np.argmax(odd))
            text = listed[at[row]]
            raise self._fault_at(name, row, f"found '{text[:40]}'{nearest(text[:40], number)}")
        values = np.array([number.get(text, -1) for text in listed], np.int64)[at] if len(listed) else np.zeros(self.num_rows, np.int64)
        values[null] = -1 if missing is None else missing
        return frozen(values)

    @cached_property
    def about(self) -> Any:
        """The document in the table's metadata; None where there is none."""
        try:
            return json_value((self.content.schema.metadata or {}).get(KEY, b"null"))
        except (ValueError, RecursionError):
            raise self.fault(f"its metadata '{KEY.decode()}' are not JSON") from None

    def about_numbers(self, name: str, length: int | None = None) -> FloatArray:
        """[length] numbers that the metadata list under a key; any number of them by default."""
        about = self.about
        listed = about.get(name) if isinstance(about, dict) else None
        kinds = {type(value) for value in listed} if isinstance(listed, list) else {None}
        if not kinds <= {int, float, bool} or (length is not None and len(listed or ()) != length):
            many = "a list of numbers" if length is None else f"a list of {length} numbers"
            raise self.fault(f"its metadata have no '{name}', expected {many}")
        if any(MOST <= abs(value) < math.inf for value in listed or ()):
            raise self.fault(f"a number of '{name}' in its metadata is too large")
        return frozen(np.array(listed, np.float64))

    def about_number(self, name: str, missing: float | None = None) -> float:
        """A number that the metadata have under a key; `missing` where it is null, if that may be."""
        about = self.about
        value = about.get(name) if isinstance(about, dict) else None
        if value is None and missing is not None:
            return missing
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < MOST:
            raise self.fault(f"its metadata have no '{name}', expected a number")
        return float(value)

    def about_texts(self, name: str | None = None) -> tuple[str, ...]:
        """Different texts that the metadata list, or list under a key."""
        about = self.about
        listed = about.get(name) if isinstance(about, dict) and name else about
        if not (isinstance(listed, list) and all(isinstance(text, str) for text in listed) and len({*listed}) == len(listed)):
            raise self.fault(f"its metadata have no '{name or KEY.decode()}', expected a list of different names")
        return tuple(listed)

    def fault(self, line: str) -> MrpSumoError:
        """An error about this table."""
        return self.error(f"{shortened(self.path)}: {line}")

    def _column(self, name: str) -> pa.ChunkedArray:
        names = self.content.column_names
        if name not in names:
            raise self.fault(f"no column '{name}', so it is of another version of this program, or damaged{nearest('', names)}")
        return self.content[name]

    def _null(self, name: str, column: pa.ChunkedArray, may_be: bool) -> BoolArray:
        """[N] where there is no value, which is refused unless it may be."""
        if not column.null_count:
            return np.zeros(len(column), np.bool_)
        null: BoolArray = column.is_null().to_numpy()
        if not may_be:
            raise self._fault_at(name, int(np.argmax(null)), "found nothing, expected a value")
        return null

    def _coded(self, name: str) -> tuple[list[str], IntArray]:
        """Each text once, and [N] which of them each row has, any for none."""
        column = self._column(name).unify_dictionaries() if pa.types.is_dictionary(self._column(name).type) else self._column(name)
        kind = column.type.value_type if pa.types.is_dictionary(column.type) else column.type
        if not (pa.types.is_string(kind) or pa.types.is_large_string(kind)):
            raise self._fault_of_type(name, column, "texts")
        if not pa.types.is_dictionary(column.type):
            column = column.dictionary_encode()
        if not column.num_chunks:
            return [], np.zeros(0, np.int64)
        try:
            listed = [text or "" for text in column.chunk(0).dictionary.to_pylist()]
        except UnicodeDecodeError:
            raise self.fault(f"column '{name}': not in UTF-8") from None
        at = np.concatenate([chunk.indices.fill_null(0).to_numpy(zero_copy_only=False) for chunk in column.chunks]).astype(np.int64)
        if len(at) and not (len(listed) and at.min() >= 0 and at.max() < len(listed)):
            if column.null_count == len(at):
                return [""], np.zeros(len(at), np.int64)
            raise self.fault(f"column '{name}' is damaged")
        return listed, at

    def _fault_at(self, name: str, row: int, line: str) -> MrpSumoError:
        return self.fault(f"column '{name}', row {row}: {line}")

    def _fault_of_type(self, name: str, column: pa.ChunkedArray, expected: str) -> MrpSumoError:
        kind = column.type.value_type if pa.types.is_dictionary(column.type) else column.type
        return self.fault(f"column '{name}' holds {str(kind)[:40]}, expected {expected}")
