"""Damage below the checksums: another value in a table or a trace of a folder, whose hashes are made right again.

What cannot be read at all is refused early and alike; what is read whole, and is not what was written, is what readers stumble over.
"""

import hashlib
import io
import json
import random
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

Damage = Callable[[bytes, random.Random], bytes]

NUMBERS = (0, -1, 1, 2**15, 2**31, 2**62, -(2**62), 1e308, -1e-320, 0.5, float("nan"), float("inf"))
TEXTS = ("", "a", "robot_0", "robot_99", "L1", "a\x1b[2J\r\x9b1m\u202e\nforged line", "x" * 3000, "done", "nobody", "²")


def damaged_table(data: bytes, chance: random.Random) -> bytes:
    """A Parquet table with one fault: in a value, a column, its rows or its metadata."""
    try:
        table = pq.read_table(io.BytesIO(data))
    except (pa.ArrowException, OSError, ValueError):
        return data
    kind = chance.randrange(9)
    if kind < 4 and table.num_rows:
        table = _with_value(table, chance)
    elif kind == 4 and table.num_columns > 1:
        table = table.drop_columns([chance.choice(table.column_names)])
    elif kind == 5 and table.num_columns:
        at = chance.randrange(table.num_columns)
        names = table.column_names
        other = chance.choice(["x", chance.choice(names)])
        table = table.rename_columns([other if k == at else name for k, name in enumerate(names)])
    elif kind == 6:
        rows = [k for k in range(table.num_rows) if chance.random() < 0.9]
        table = chance.choice([table.slice(0, 0), table.slice(1), table.take(pa.array(rows, pa.int64())), pa.concat_tables([table, table])])
    elif kind == 7 and table.num_columns:
        at = chance.randrange(table.num_columns)
        column = pa.array(
            [float(chance.choice(NUMBERS)) if chance.random() < 0.5 else None for _ in range(table.num_rows)],
            pa.float64(),
            from_pandas=False,
        )
        other = chance.choice([column, pa.array(["a"] * table.num_rows), pa.array([[1]] * table.num_rows), pa.nulls(table.num_rows)])
        table = table.set_column(at, table.column_names[at], other)
    elif about := (table.schema.metadata or {}).get(b"mrp_sumo"):
        table = table.replace_schema_metadata({"mrp_sumo": damaged_json(about, chance)})
    sink = io.BytesIO()
    pq.write_table(table, sink, compression="zstd")
    return sink.getvalue()


def _with_value(table: pa.Table, chance: random.Random) -> pa.Table:
    """The table with another value, or none, in a row."""
    at = chance.randrange(table.num_columns)
    values = table.column(at).to_pylist()
    kind = table.schema.field(at).type
    plain = kind.value_type if pa.types.is_dictionary(kind) else kind
    row = chance.choice([0, len(values) - 1, chance.randrange(len(values))])
    pool: tuple[Any, ...] = TEXTS if pa.types.is_string(plain) else (True, False) if pa.types.is_boolean(plain) else NUMBERS
    for _ in range(8):
        values[row] = chance.choice([None, chance.choice(values), *chance.sample(pool, min(6, len(pool)))])
        try:
            column = pa.array(values, plain)
        except (pa.ArrowException, OverflowError, ValueError, TypeError, NotImplementedError):
            continue
        return table.set_column(at, table.column_names[at], column)
    return table


def damaged_json(data: bytes, chance: random.Random) -> bytes:
    """A JSON document with another value, or none, at one place."""
    from campaigns.fuzz import VALUES, places_in

    try:
        document = json.loads(data)
    except (ValueError, RecursionError):
        return data
    places = list(places_in(document))
    if not places:
        return b"null"
    parent, key = chance.choice(places)
    match chance.randrange(4):
        case 0:
            del parent[key]
        case 1:
            other, which = chance.choice(places)
            parent[key] = other[which] if other is not parent or not isinstance(parent, list) else None
        case _:
            parent[key] = chance.choice(VALUES)
    try:
        return json.dumps(document).encode(errors="surrogatepass")
    except (ValueError, RecursionError):
        return b"[]"


def damaged_member(name: str, data: bytes, chance: random.Random) -> bytes:
    """A file of a run with a fault inside its format."""
    if name.endswith(".parquet"):
        return damaged_table(data, chance)
    if not name.endswith((".json", ".jsonl")):
        from campaigns.fuzz import damaged

        return damaged(data, chance)
    if name.endswith(".jsonl"):
        lines = data.splitlines()
        if not lines:
            return b"{}\n"
        at = chance.randrange(len(lines))
        lines[at] = damaged_json(lines[at], chance)
        return b"\n".join(lines) + b"\n"
    return damaged_json(data, chance)


def damage_run(run: Path, chance: random.Random) -> None:
    """Damage a file of a run folder, and have `result.json` say that it was written so."""
    names = sorted(p.name for p in run.iterdir() if p.is_file())
    path = run / chance.choice(names)
    path.write_bytes(damaged_member(path.name, path.read_bytes(), chance))
    try:
        result = json.loads((run / "result.json").read_text())
        if path.name in result["files"]:
            data = path.read_bytes()
            result["files"][path.name] |= {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
            (run / "result.json").write_text(json.dumps(result))
    except (ValueError, KeyError, TypeError, AttributeError):
        pass  # it is what is damaged


def damage_trace(batch: Path, chance: random.Random) -> None:
    """Damage a file in the trace of a run of a batch, or the floor that runs share."""
    import gzip

    path = chance.choice(sorted(batch.glob("runs/*/*.trace")))
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    name = chance.choice(sorted(files))
    if name == "floor":
        old = files["floor"].decode()
        floor = gzip.compress(damaged_json(gzip.decompress((batch / "floors" / old).read_bytes()), chance), mtime=0)
        files["floor"] = f"{hashlib.sha256(floor).hexdigest()[:32]}.json.gz".encode()
        (batch / "floors" / files["floor"].decode()).write_bytes(floor)
    else:
        files[name] = damaged_member(name, files[name], chance)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)


def damage_results(batch: Path, chance: random.Random) -> None:
    """Damage the table of a batch, and have its checksum right."""
    path = batch / "results.parquet"
    path.write_bytes(damaged_table(path.read_bytes(), chance))
    sums = [f"{hashlib.sha256((batch / name).read_bytes()).hexdigest()}  {name}\n" for name in ("results.csv", "results.parquet")]
    (batch / "results.sha256").write_text("".join(sums))


def damage_any(folder: Path, chance: random.Random) -> None:
    """Damage a JSON file of a batch or a study, with its checksum made right where it has one."""
    path = chance.choice(sorted(p for p in folder.rglob("*.json") if "kept" not in p.parts))
    document = json.loads(path.read_bytes())
    if isinstance(document, dict) and {"crc32", "record"} <= document.keys():
        body = damaged_json(json.dumps(document["record"], separators=(",", ":")).encode(), chance)
        path.write_bytes(b'{"crc32":"%08x","record":' % zlib.crc32(body) + body + b"}\n")
    else:
        path.write_bytes(damaged_json(path.read_bytes(), chance))
