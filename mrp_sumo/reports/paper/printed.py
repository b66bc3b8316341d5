"""The numbers that the MRP-Bench paper prints, read from `data/mrp_bench_paper.yaml`."""

from functools import cache
from pathlib import Path
from typing import Any

import yaml

FILE = Path(__file__).parents[2] / "data" / "mrp_bench_paper.yaml"
THEIR_NAMES = {"airport_terminal": "airport"}  # of MRP-Bench's files


@cache
def numbers_of_paper() -> dict[str, Any]:
    """All of the file: table -> rows."""
    content: dict[str, Any] = yaml.safe_load(FILE.read_text(encoding="utf-8"))
    return content


def printed(*place: str) -> float | None:
    """The number at a place such as `("table_2", "office", "cbs")`; None where the paper prints none."""
    at: Any = numbers_of_paper()
    for key in place:
        at = at.get(key) if isinstance(at, dict) else None
    return at if isinstance(at, int | float) else None


def map_of_paper(name: str) -> str:
    """The paper's name of a map."""
    base = name.split(", ", 1)[0]
    return THEIR_NAMES.get(base, base)
