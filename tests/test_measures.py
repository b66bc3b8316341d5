"""What measures of simplicity count, on sources known by hand."""

import ast

import pytest
from test_architecture import tool

MEASURES = tool("measures")
STATE = "class Grants(NamedTuple):\n    cause: IntArray\n    other: IntArray"


def trees(**sources):
    return {f"mrp_sumo/{path.replace('__', '/')}.py": ast.parse(source) for path, source in sources.items()}


def test_class_of_two_files_has_two_meanings():
    assert MEASURES.class_names(trees(a="class One: ...", b="class One: ...\nclass Two: ...")) == ["One: mrp_sumo/a.py, mrp_sumo/b.py"]


@pytest.mark.parametrize(
    ("parameters", "too_many"), [("a, b, c, d, e, f, g", 0), ("self, a, b, c, d, e, *, f", 0), ("a, b, c, d, e, f, *g, **h", 1)]
)
def test_eighth_argument_is_too_many(parameters, too_many):
    assert len(MEASURES.arguments(trees(a=f"def f({parameters}): ..."))) == too_many


@pytest.mark.parametrize(
    ("second", "shared"),
    [
        ("def g(state): state.grants.cause[0] += 1", ["grants.cause"]),
        ("def g(grants):\n    o, c = grants.other, grants.cause\n    c[0] = 1", ["grants.cause"]),
        ("def g(state): print(state.grants.cause[0])", []),
        ("def g(state): state.waits.cause[0] = 1", []),
        ("def g(state): state.grants.other[0] = 1", []),
    ],
)
def test_array_that_two_files_write_has_several_writers(second, shared):
    both = trees(drive__state=STATE, drive__first="def f(grants): grants.cause[0] = 1", drive__second=second)
    assert [place.partition(":")[0] for place in MEASURES.writers(both)] == shared


@pytest.mark.parametrize(
    ("source", "num"),
    [
        ("from numba.core import _dispatcher", 1),
        ("import numba\nnumba._devicearray", 1),
        ("some.dispatcher._compiler", 1),
        ("self._own = 1\nother._own", 0),
        ("from planners._astar import _x", 0),
        ("pair._replace(a=1)", 0),
        ("import numpy\nnumpy.__version__", 0),
    ],
)
def test_private_names_of_others_are_counted(source, num):
    assert len(MEASURES.private_names(trees(a=source))) == num


def test_private_name_that_another_folder_defines_is_not_ours():
    parser, own = "parser._actions", "def _actions(): ..."
    assert len(MEASURES.private_names(trees(**{"cli/a.py": parser, "core/b.py": own}))) == 1
    assert MEASURES.private_names(trees(**{"cli/a.py": parser, "cli/b.py": own})) == []


def test_types_are_followed_through_fields_quotes_and_names_of_annotations(monkeypatch):
    monkeypatch.setattr(MEASURES, "MAIN_PATH", {"mrp_sumo/a.py": "run"})
    source = 'Calls = list["Third"]\nclass First:\n    second: "Second | None"\nclass Second:\n    calls: Calls\nclass Third: ...\n'
    assert MEASURES.main_path_types(trees(a=source + "class Fourth: ...\ndef run(a: First) -> int: ...")) == ["First", "Second", "Third"]


def test_files_that_a_planner_pulls_in_are_those_of_planners_it_imports_at_any_depth():
    files = {
        "planners/a.py": ast.parse("from planners import _b\nfrom mrp_sumo import core"),
        "planners/_b.py": ast.parse("from planners._c import search"),
        "planners/_c.py": ast.parse(""),
        "planners/d.py": ast.parse("import planners.a"),
    }
    assert MEASURES.pulled_in("planners/a.py")(files) == ["planners/_b.py", "planners/_c.py", "planners/a.py"]
