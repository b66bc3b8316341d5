"""No name is of the private dialect, and no docstring asks instead of naming the thing."""

from pathlib import Path

import pytest
from test_architecture import tool

WORDS = tool("words")


@pytest.mark.parametrize("room", [pytest.param(room, marks=() if asks else pytest.mark.slow) for room, asks in WORDS.ROOMS.items()])
def test_no_dialect_and_no_docstrings_that_ask(room):
    assert [fault for path in WORDS.sources(room) for fault in WORDS.faults_of(path)] == []


@pytest.mark.parametrize(
    ("source", "faults"),
    [
        ("found = 1", [("names", "found")]),
        ("def f(way, *, kept=1): ...", [("names", "way"), ("names", "kept")]),
        ("class Around:\n    moment: int", [("names", "moment")]),
        ("for asked in (): ...", [("names", "asked")]),
        ("print(found, self.found, ways, found_way)", []),
        ('def f():\n    """What it does."""', [("docstrings", "What")]),
        ('def _f():\n    """What it does."""', []),
        ('"""Whether it is."""', [("docstrings", "Whether")]),
        ('def f():\n    """Callbacks of a running batch."""', []),
    ],
)
def test_what_counts(tmp_path, source, faults):
    file = Path(tmp_path, "some.py")
    file.write_text(source)
    assert sorted((kind, word) for _, _, kind, word in WORDS.faults_of(file)) == sorted(faults)
