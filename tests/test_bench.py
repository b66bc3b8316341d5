"""Benchmarks are cases of one harness: they are listed, called, printed and compared in one way."""

import ast
import json
import subprocess
import sys

import pytest
from test_architecture import PROJECT, tool

BENCH = tool("bench")
CASES = sorted((PROJECT / "tools").glob("bench_*.py"))


@pytest.mark.parametrize("path", CASES, ids=lambda path: path.stem)
def test_case_says_what_it_measures_has_options_and_rows_and_is_called_by_its_name(path):
    tree = ast.parse(path.read_text())
    assert {"arguments", "rows"} <= {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    assert path.name in ast.get_docstring(tree)
    assert path.read_text().endswith("    sys.exit(bench.main(__file__))\n")


def test_rows_are_a_table_with_a_new_head_where_columns_change(capsys):
    BENCH.shown([{"a": 1, "cpu_s": 0.123456}, {"a": 2, "cpu_s": None}, {"b": True}], as_json=False)
    lines = capsys.readouterr().out.splitlines()[2:]
    assert [line for line in lines if line] == [
        "| a | cpu_s |",
        "|---|---|",
        "| 1 | 0.1235 |",
        "| 2 | – |",
        "| b |",
        "|---|",
        "| yes |",
    ]


def test_rows_are_lines_of_json(capsys):
    BENCH.shown([{"a": 1}, {"a": 2.5}], as_json=True)
    assert [json.loads(line) for line in capsys.readouterr().out.splitlines()] == [{"a": 1}, {"a": 2.5}]


def test_two_checkouts_are_measured_in_turn_and_medians_of_what_varies_are_compared(tmp_path, monkeypatch):
    script = "import json, os, pathlib\nlog = pathlib.Path('../log')\nn = len(log.read_text()) if log.exists() else 0\n"
    script += "log.write_text('x' * (n + 1))\nprint(json.dumps({'case': 'one', 'robots': 3, 'cpu_s': FACTOR * (1 + n)}))\n"
    for name, factor in (("here", 1), ("there", 2)):
        (tmp_path / name / "tools").mkdir(parents=True)
        (tmp_path / name / "tools" / "bench_fake.py").write_text(script.replace("FACTOR", str(factor)))
    monkeypatch.setattr(BENCH, "TOOLS", tmp_path / "here" / "tools")
    (row,) = BENCH.compared("bench_fake.py", [], tmp_path / "there", 3)
    # calls 0, 2, 4 here and 1, 3, 5 there: medians 3 and 2 * 4
    assert row == {"row": "case one, robots 3", "figure": "cpu_s", "here": 3, "there": 8, "here / there": 0.375}


@pytest.mark.parametrize(("words", "code", "said"), [([], 0, "machine"), (["nothing"], 2, "nothing: no such case")])
def test_cases_are_listed_and_others_refused(words, code, said):
    done = subprocess.run([sys.executable, PROJECT / "tools" / "bench.py", *words], capture_output=True, text=True, check=False)
    assert done.returncode == code
    assert said in done.stdout + done.stderr and "Traceback" not in done.stderr


def test_program_that_fails_is_a_line_of_its_own_words():
    with pytest.raises(ValueError, match="exit code 3\nno luck"):
        BENCH.process([sys.executable, "-c", "import sys; print('no luck', file=sys.stderr); sys.exit(3)"])
