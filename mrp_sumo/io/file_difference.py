"""First difference of two files of runs, in words."""

from pathlib import Path


def first_difference(old: Path, new: Path) -> str:
    """The first value of a table, or line of a text, that is another; the sizes of other files.

    Parameters
    ----------
    old, new
        Files whose bytes differ; a missing old file is reported as such.
    """
    if not old.is_file():
        return "is missing"
    if old.suffix == ".parquet":
        from mrp_sumo.io.tables import read_table

        a, b = read_table(old).content, read_table(new).content
        if a.column_names != b.column_names or a.num_rows != b.num_rows:
            return f"{a.num_rows} rows of {len(a.column_names)} columns became {b.num_rows} of {len(b.column_names)}"
        for name in a.column_names:
            for row, (x, y) in enumerate(zip(a[name].to_pylist(), b[name].to_pylist())):
                if repr(x) != repr(y):
                    return f"{name} in row {row} is {y}, was {x}"
    if old.suffix in (".json", ".jsonl", ".yaml", ".xml"):
        for number, (x, y) in enumerate(zip(old.read_bytes().splitlines(), new.read_bytes().splitlines()), 1):
            if x != y:
                return f"line {number} differs"
    return f"{old.stat().st_size} bytes became {new.stat().st_size}"
