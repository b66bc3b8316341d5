"""One registry: plug-ins of packages and files are found, checked and made, and what is missing is one line."""

import sys
from pathlib import Path

import pytest

from mrp_sumo.errors import PlugInError, ScenarioError
from mrp_sumo.plugins import registry
from mrp_sumo.plugins.face import check_face, check_methods
from mrp_sumo.plugins.kinds import KINDS
from mrp_sumo.plugins.parameters import REQUIRED, parameters_of
from mrp_sumo.plugins.source import digest

PLANNER = """
from dataclasses import dataclass
from typing import ClassVar

@dataclass(frozen=True)
class Mine:
    patience: int = 3
    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "none"

    def prepare(self):
        pass

    def plan(self, problem, time_limit_s):
        return None
"""


@pytest.fixture(autouse=True)
def fresh():
    path = list(sys.path)
    yield
    sys.path[:] = path
    registry.forget()


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Installs a package of one entry point."""

    def install(group, entry, **modules):
        info = tmp_path / "thing-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: thing\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[{group}]\n{entry}\n")
        for name, text in modules.items():
            (tmp_path / f"{name}.py").write_text(text)
            monkeypatch.delitem(sys.modules, name, raising=False)
        monkeypatch.syspath_prepend(tmp_path)
        registry.forget()

    return install


def written(tmp_path, text, name="mine.py"):
    (tmp_path / name).write_text(text)
    return f"./{name}:Mine"


def test_class_of_a_file_is_made_with_its_parameters(tmp_path):
    made = registry.make("planners", written(tmp_path, PLANNER), {"patience": 5}, tmp_path)
    assert made.patience == 5


@pytest.mark.parametrize("group", ["mrp_sumo.plugins", "mrp_sumo.planners"])
def test_package_brings_planners_by_a_table(installed, group):
    installed(group, "thing = thing_table:TABLE", thing_table='TABLE = {"planners": {"mine": "thing_mine:Mine"}}', thing_mine=PLANNER)
    assert "mine" in registry.names("planners")
    assert registry.make("planners", "mine", {}).patience == 3


def test_package_cannot_take_a_name_of_ours(installed):
    installed("mrp_sumo.plugins", "a = thing_table:TABLE", thing_table='TABLE = {"policies": {"adg": "thing:Mine"}}')
    assert registry.find("policies", "adg").ours


@pytest.mark.parametrize(
    ("table", "says"),
    [('["planners"]', "expected a table by kind"), ('{"planners": {"mine": 3}}', "planners: expected names with places")],
)
def test_table_of_another_form_is_refused(installed, table, says):
    installed("mrp_sumo.plugins", "thing = thing_table:TABLE", thing_table=f"TABLE = {table}")
    with pytest.raises(ScenarioError, match=says):
        registry.names("planners")


WRONG = {
    "mine.py:6: Mine is no planner: it has no method prepare()": ("def prepare", "def prepaer"),
    "mine.py:14: Mine is no planner: it has plan(problem), expected plan(problem, time_limit_s)": ("problem, time_limit_s", "problem"),
    "mine.py:6: Mine is no planner: it has no attribute 'guarantee'": ('    guarantee: ClassVar[str] = "none"\n', ""),
    "mine.py:6: Mine is no planner: 'assigns' is 'no', expected bool": ("ClassVar[bool] = False", "ClassVar[str] = 'no'"),
    "mine.py:12: in __post_init__: ZeroDivisionError: division by zero": (
        "    def prepare",
        "    def __post_init__(self):\n        1 / 0\n\n    def prepare",
    ),
    "mine.py:5: RuntimeError: not today": ("@dataclass", "raise RuntimeError('not today')\n@dataclass"),
    "mine.py:5: ended the program (SystemExit: 0)": ("@dataclass", "import sys; sys.exit(0)\n@dataclass"),
    "mine.py:5: ModuleNotFoundError: No module named 'not_there'": ("@dataclass", "import not_there\n@dataclass"),
}


@pytest.mark.parametrize("says", WRONG)
def test_what_is_wrong_is_one_line_with_file_and_line(tmp_path, says):
    name = written(tmp_path, PLANNER.replace(*WRONG[says]))
    with pytest.raises(PlugInError) as result:
        registry.make("planners", name, {}, tmp_path)
    assert str(result.value).endswith(says)


def test_methods_of_the_protocol_itself_are_missing(tmp_path):
    text = "from mrp_sumo.planning.protocol import Planner\n\nclass Mine(Planner):\n    pass\n"
    with pytest.raises(PlugInError, match=r"mine.py:3: Mine is no planner: it has no method prepare\(\)"):
        registry.make("planners", written(tmp_path, text), {}, tmp_path)


@pytest.mark.parametrize(
    ("name", "parameters", "says"),
    [
        ("./mien.py:Mine", {}, r"no such file: .*mien.py \(did you mean 'mine.py'\?\)"),
        ("./mine.py:Mien", {}, r"mine.py has no 'Mien' \(did you mean 'Mine'\?\)"),
        ("./mine.py:Mine", {"patients": 3}, r"unknown parameter 'patients' \(did you mean 'patience'\?\)"),
        ("./mine.py:Mine", {"patience": "long"}, "patience is 'long', expected a whole number"),
        ("./wrong.py:Mine", {}, r"wrong.py:1: SyntaxError"),
    ],
)
def test_choice_that_cannot_be_right_is_bad_input(tmp_path, name, parameters, says):
    written(tmp_path, PLANNER)
    written(tmp_path, "class Mine", "wrong.py")
    with pytest.raises(ScenarioError, match=says):
        registry.make("planners", name, parameters, tmp_path)


def test_file_is_not_executed_before_it_is_used(tmp_path):
    name = written(tmp_path, "raise RuntimeError\n" + PLANNER)
    assert registry.find("planners", name, tmp_path).path == (tmp_path / "mine.py").resolve()


def test_changed_file_is_loaded_again(tmp_path):
    assert registry.make("planners", written(tmp_path, PLANNER), {}, tmp_path).patience == 3
    assert registry.make("planners", written(tmp_path, PLANNER.replace("= 3", "= 4")), {}, tmp_path).patience == 4


def test_file_imports_what_stands_beside_it(tmp_path):
    (tmp_path / "beside_it.py").write_text("PATIENCE = 7\n")
    text = "from beside_it import PATIENCE\n" + PLANNER.replace("= 3", "= PATIENCE")
    assert registry.make("planners", written(tmp_path, text), {}, tmp_path).patience == 7


def test_digest_follows_imports_from_the_own_folder(tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "__init__.py").write_text("")
    (tmp_path / "parts" / "deep.py").write_text("from . import deeper\n")
    (tmp_path / "parts" / "deeper.py").write_text("X = 1\n")
    (tmp_path / "other.py").write_text("X = 1\n")
    name = written(tmp_path, "def f():\n    from parts.deep import deeper\n" + PLANNER)

    def now():
        return digest(registry.find("planners", name, tmp_path))

    before = now()
    (tmp_path / "other.py").write_text("X = 2\n")
    assert now() == before
    (tmp_path / "parts" / "deeper.py").write_text("X = 2\n")
    assert now() != before


def test_digest_follows_imports_from_the_own_package(installed, tmp_path):
    package = tmp_path / "thing_package"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "mine.py").write_text("from thing_package.part import X\n" + PLANNER)
    (package / "part.py").write_text("X = 1\n")
    table = 'TABLE = {"planners": {"mine": "thing_package.mine:Mine"}}'
    installed("mrp_sumo.plugins", "thing = thing_table:TABLE", thing_table=table)
    before = digest(registry.find("planners", "mine"))
    (package / "part.py").write_text("X = 2\n")
    assert digest(registry.find("planners", "mine")) != before


def test_digest_is_the_same_in_another_folder(tmp_path):
    for folder in ("a", "b"):
        Path(tmp_path / folder).mkdir()
        written(tmp_path / folder, PLANNER)
    first, second = (digest(registry.find("planners", f"{folder}/mine.py:Mine", tmp_path)) for folder in ("a", "b"))
    assert first == second


def test_whole_number_is_a_number_unless_no_number_holds_it():
    assert registry.make("planners", "ecbs", {"w": 10**3}).w == 1000.0
    with pytest.raises(ScenarioError, match=r"planner 'ecbs': w is 10+, expected a number"):
        registry.make("planners", "ecbs", {"w": 10**400})


def ours():
    """Every plug-in that comes with this program, of the kinds with a face: kind and name."""
    return [(kind, name) for kind, each in KINDS.items() if each.face and each.ours for name in registry._ours(kind)]


@pytest.mark.parametrize(("kind", "name"), ours())
def test_ours_have_what_their_kind_needs(kind, name):
    each, plug_in = KINDS[kind], registry.target(kind, name)
    if each.made:
        check_methods(plug_in, registry.face_of(each), each.one)
        known = {parameter.name: parameter.default for parameter in parameters_of(plug_in)}
        if REQUIRED in known.values():
            return
        plug_in = plug_in(**({"command": "program {map} {out}"} if "command" in known else {}))
    check_face(plug_in, registry.face_of(each), each.one)
