"""Each array of a running execution is written in one module, which `state.OWNERS` names: read from the sources, see tests/writers.py."""

from pathlib import Path

import pytest

from mrp_sumo.drive import state
from tests.writers import Records, writers

PROJECT = Path(__file__).resolve().parents[2]
ROOMS = ("core", "crowd", "drive", "engines", "search", "wire")  # and whoever else imports the drive


def sources():
    paths = sorted(p for folder in ("mrp_sumo", "planners") for p in (PROJECT / folder).rglob("*.py"))
    texts = {p.relative_to(PROJECT).as_posix(): p.read_text() for p in paths}
    return {path: text for path, text in texts.items() if path.split("/")[1] in ROOMS or "mrp_sumo.drive" in text}


def owner(record, field):
    """The path of the module that is to write an array."""
    of_record = state.OWNERS[record]
    return f"mrp_sumo/drive/{of_record if isinstance(of_record, str) else of_record.get(field, of_record[''])}.py"


@pytest.fixture(scope="module")
def written():
    """Who writes each array, by record and field."""
    return writers(sources())


def test_each_array_is_written_by_its_owner_alone(written):
    wrong = [
        f"{record}.{field} is written by {sorted(paths)}, expected {owner(record, field)} alone"
        for (record, field), paths in sorted(written.items())
        if paths != {owner(record, field)}
    ]
    assert not wrong, "\n".join(wrong)
    assert {record for record, _ in written} == set(state.OWNERS)  # and none is overlooked


def test_every_array_of_motion_grants_and_waits_is_found_to_be_written(written):
    fields = Records(sources()).fields
    for record in ("Motion", "Grants", "Holds", "Claims", "Waits", "Yielding", "Margin"):
        assert {field for field in fields[record] if (record, field) not in written} <= {"steps"}  # of margins: given


SECOND = {  # ways to write an array beside its owner
    "an element": "def other(state):\n    state.holds.holder[0] = 1",
    "another name": "def other(self):\n    held = self.ledger.state.holds.holder\n    held[2:] += 1",
    "a name for a part": "def other(holds):\n    some = holds.holder[3:]\n    some[0] = 1",
    "in place": "def other(holds):\n    holds.holder += 1",
    "out": "import numpy as np\ndef other(scene):\n    np.add(1, 2, out=scene.state.holds.holder)",
    "a method": "def other(holds):\n    holds.holder.fill(1)",
    "a function of NumPy": "import numpy as np\ndef other(holds):\n    np.add.at(holds.holder, [0], 1)",
    "a kernel": "def inner(into):\n    into[0] = 1\n\ndef middle(a):\n    inner(a)\n\ndef other(holds):\n    middle(holds.holder)",
    "a record under another name": "def inner(record):\n    record.holder[0] = 1\n\ndef other(holds):\n    inner(holds)",
    "its class": "def other(record: Holds) -> None:\n    record.holder[0] = 1",
    "one of some": "def other(holds, waits):\n    for each in (holds.holder, waits.where):\n        each[:] = 0",
    "all together": "def other(holds):\n    (holds.held[0], holds.holder[0]) = (1, 2)",
}


@pytest.mark.parametrize("how", SECOND)
def test_a_second_writer_is_seen(how):
    path = "mrp_sumo/drive/state.py"
    texts = {path: (PROJECT / path).read_text(), "mrp_sumo/drive/other.py": SECOND[how]}
    assert writers(texts)["Holds", "holder"] == {"mrp_sumo/drive/other.py"}


@pytest.mark.parametrize(
    "text",
    [
        "def other(holds):\n    holder = holds.holder.copy()\n    holder[0] = 1",
        "def other(holds):\n    some = holds.holder[[0, 1]]\n    some[0] = 1",
        "def other(waits: list) -> None:\n    waits[0] = 1",
        "def inner(into, values):\n    into[0] = values[0]\n\ndef other(holds, into):\n    inner(into, holds.holder)",
    ],
)
def test_copies_and_reading_are_no_writing(text):
    path = "mrp_sumo/drive/state.py"
    assert not writers({path: (PROJECT / path).read_text(), "mrp_sumo/drive/other.py": text})
