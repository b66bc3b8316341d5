"""Folders of results that are not there: refused at once, with the place that may be meant."""

import subprocess
import sys

import pytest

from mrp_sumo.cli.main import main


@pytest.mark.parametrize(
    "line", ["replay {}", "render {} --at 0 --out x.png", "report {}", "export {} --csv", "query {}", "compare {} {}", "status {}"]
)
@pytest.mark.parametrize(
    ("name", "hint"),
    [("mine", " (did you mean 'runs/mine'?)"), ("office_9", "; `mrp-sumo run office_9` makes runs/office_9"), ("nowhere", "")],
)
def test_place_that_may_be_meant_is_named(tmp_path, monkeypatch, capsys, line, name, hint):
    (tmp_path / "runs" / "mine").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    assert main(line.format(name, name).split()) == 2
    assert capsys.readouterr().err == f"mrp-sumo: {name}: no such folder{hint}\n"


REFUSED = [
    *("report nowhere", "render nowhere --at 0 --out x.png", "compare a b", "query nowhere", "capacity nowhere", "run nowhere"),
    *("render . --at 0", "render . --video x.gif --size 1x1", "generate nope", "run office_9 --robots 5000"),
    "run office --robots 4 --set discretisation.kind=grid --set discretisation.cell_m=40",
]


def test_refusal_loads_nothing_that_reads_draws_or_drives():
    code = (
        f"import sys\nfrom mrp_sumo.cli.main import main\nfor line in {REFUSED!r}:\n"
        f"    print(main(line.split()), [n for n in {HEAVY!r} if n in sys.modules])"
    )
    ended = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True)
    assert ended.stdout.splitlines() == ["2 []"] * len(REFUSED), ended.stdout


HEAVY = ("matplotlib", "pandas", "duckdb", "libsumo", "pyarrow", "numba", "ortools", "scipy")
