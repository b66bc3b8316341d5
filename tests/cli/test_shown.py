"""Text of anybody's files on a terminal: nothing in it ends a line, moves the cursor or forges a line of ours; and how a command ends."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from rich.table import Table
from rich.text import Text

from mrp_sumo.cli.main import main
from mrp_sumo.cli.printing import print_failure, print_table, say, warn
from mrp_sumo.errors import MapError, MrpSumoError, ScenarioError, shown

CONSOLE = Path(sys.executable).with_name("mrp-sumo")
EVIL_TEXT = "\x1b[2J\x1b[31m\rCR\x9b1m\u202e"
EVIL = """\
name: evil
levels:
  "L1\\e[2J\\nmrp-sumo: all is well":
    vertices: [[0, 0, 0, a], [100, 0, 0, b]]
    measurements: [[0, 1, {distance: [3, 10]}]]
    lanes: [[0, 1, {graph_idx: [2, 0], orientation: [1, "x\\e[31m\\nforged"]}]]
"""


def test_controls_are_written_out_and_letters_of_all_scripts_kept():
    assert shown("a\x1b[2J\r\n\x85\u2028\u202eb") == "a\\x1b[2J\\r\\n\\x85\\u2028\\u202eb"
    assert shown("Küche 厨房 ²") == "Küche 厨房 ²"


@pytest.mark.parametrize("kind", [MrpSumoError, MapError])
def test_error_is_one_line(kind):
    assert str(kind("found 'x\nmrp-sumo: fine'")) == "found 'x\\nmrp-sumo: fine'"


def test_faults_of_a_scenario_are_a_line_each():
    error = ScenarioError("one\nforged", "two")
    assert error.lines == ("one\\nforged", "two") and str(error) == "one\\nforged\ntwo"


@pytest.mark.parametrize(
    "line",
    ["import evil.building.yaml --check", "import evil.building.yaml --json", "run evil.building.yaml", "convert evil.building.yaml x.map"],
)
def test_map_forges_no_line(tmp_path, monkeypatch, capsys, line):
    (tmp_path / "evil.building.yaml").write_text(EVIL)
    monkeypatch.chdir(tmp_path)
    assert main(line.split()) == 2
    printed = capsys.readouterr()
    assert "\x1b" not in printed.out + printed.err and "\\x1b[2J\\nmrp-sumo: all is well" in printed.out + printed.err
    assert len((printed.out + printed.err).splitlines()) == 1


def test_text_of_a_file_that_is_printed_moves_no_cursor(tmp_path):
    (tmp_path / "results.csv").write_text("")
    code = "from mrp_sumo.cli import main as m; m._of_the_process(); print('a\\x1b[2J\\rb\\x1b[1;31mred\\x1b[0m\\x9b\\x1b[8mhidden')"
    assert (
        subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True).stdout
        == "a\\x1b[2J\\rb\x1b[1;31mred\x1b[0m\\x9b\\x1b[8mhidden\n"
    )


def test_whatever_a_command_prints_goes_through_one_file():
    prints = re.compile(r"(?<![\w.])print\(|std(out|err)\.write\(")
    folder = Path(say.__code__.co_filename).parent
    assert [path.name for path in sorted(folder.glob("*.py")) if prints.search(path.read_text())] == ["printing.py"]


def test_line_stays_one_line_and_a_table_moves_no_cursor(capsys):
    table = Table(box=None, show_header=False)
    table.add_row(Text(f"name{EVIL_TEXT}"), "second")
    say(f"name{EVIL_TEXT}", "next")
    print_table(table, 100)
    warn(f"name{EVIL_TEXT}")
    print_failure("planner failed", f"name{EVIL_TEXT}", f"Traceback:\n  {EVIL_TEXT}")
    printed = capsys.readouterr()
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e]", printed.out + printed.err)
    assert printed.out.splitlines()[:2] == ["name\\x1b[2J\\x1b[31m\\rCR\\x9b1m\\u202e", "next"] and printed.err.startswith(
        "mrp-sumo: name\\x1b[2J"
    )


def test_results_of_a_stranger_forge_no_line(tmp_path, monkeypatch, capsys):
    (tmp_path / "s.yaml").write_text(
        "name: s\nbase: {map: office, robots: 1, planner: astar}\ngrid_search: {seed: 0..1}\nuntil: plan\nviews: {v: select 1 as one}\n"
    )
    monkeypatch.chdir(tmp_path)
    assert main(["batch", "s.yaml", "--out", "results", "--workers", "1"]) == 0
    path = tmp_path / "results" / "plan.json"
    text = json.dumps(json.loads(path.read_text()))
    for old, command in (('"suite": "s"', "status"), ('"views": {"v"', "query"), ('"views": {"v": "select 1', "query")):
        assert old in text
        path.write_text(text.replace(old, old[:-1] + json.dumps(EVIL_TEXT + "\nFORGED")[1:-1] + old[-1]))
        capsys.readouterr()
        main([command, "results"])
        printed = capsys.readouterr().out
        assert "FORGED" in printed and not re.search("[\x1b\r\x9b\u202e]|^FORGED", printed, re.MULTILINE), old


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("map: office\nrobots: four\n", "s.yaml:2: robots: found 'four', expected a number of robots, such as 4, or keys and values"),
        ("map: office\nrobots:\n\tcount: 2\n", "s.yaml:3: not YAML: found a tab, expected spaces"),
        (
            "map:office\nrobots: 2\n",
            "s.yaml:2: not YAML: mapping values are not allowed in this context; line 1 has no space after its colon",
        ),
        (
            "map: office\nrobots: 2\nexecution: {time_limit_s: 5min}\n",
            "s.yaml:3: execution.time_limit_s: found '5min', expected a number of seconds, such as 300",
        ),
        (
            "map: office\nrobots: 2\nexecution: {time_limit_s: soon}\n",
            "s.yaml:3: execution.time_limit_s: found 'soon', expected a number of seconds",
        ),
        (
            "map: office\nrobots: 2\ndiscretisation: {cell_m: 40cm}\n",
            "s.yaml:3: discretisation.cell_m: found '40cm', expected a number of metres, such as 0.4",
        ),
        ("map: office\nrobots: 2\nseed: abc\n", "s.yaml:3: seed: found 'abc', expected a whole number"),
        (
            "map: office\nrobots: 2\nname: put away\n",
            "s.yaml:3: name: found 'put away', expected letters, digits and _ . + - only, such as 'put_away'",
        ),
    ],
)
def test_line_about_a_value_says_what_to_write(tmp_path, monkeypatch, capsys, text, line):
    (tmp_path / "s.yaml").write_text(text)
    monkeypatch.chdir(tmp_path)
    assert main(["plan", "s.yaml"]) == 2
    assert capsys.readouterr().err == f"mrp-sumo: {line}\n"


@pytest.mark.parametrize(
    ("line", "output"),
    [
        ("run office_5 --robots four", "--robots: found 'four', expected a whole number"),
        ("run office_5 --time-limit 5min", "--time-limit: found '5min', expected a number of seconds, such as 300"),
        ("vda5050 office_5 --broker x --duration soon", "--duration: found 'soon', expected a number;"),
        ("run office_5 --planner", "--planner: expected a value after it"),
        ("run office_5 --max-time 20", "unrecognized arguments: --max-time 20; other keys of the scenario: --set KEY=VALUE; see"),
        ("run office_5 -planner cbs", "unrecognized arguments: -planner cbs (did you mean '--planner'?)"),
        ("generate wherehouse --out x", "kind: found 'wherehouse', expected one of 'warehouse', 'grid', 'ring', 'random'"),
        ("run office_5.yml", "office_5.yml: no such file (did you mean 'office_5'?)"),
        ("batch office_5", "no suite 'office_5': neither a file nor a bundled suite; it is a scenario: `mrp-sumo run office_5`"),
    ],
)
def test_line_about_an_argument_says_what_to_write(capsys, line, output):
    assert main(line.split()) == 2
    assert capsys.readouterr().err.startswith(f"mrp-sumo: {output}")


def test_refused_batch_leaves_no_lock_behind(tmp_path, capsys):
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "mine.txt").write_text("x")
    (tmp_path / "s.yaml").write_text("base: {map: nowhere, robots: 2}\ngrid_search: {seed: [0]}\n")
    assert main(["batch", str(tmp_path / "s.yaml"), "--out", str(tmp_path / "results")]) == 2
    assert main(["status", str(tmp_path / "results")]) == 2
    assert [p.name for p in (tmp_path / "results").iterdir()] == ["mine.txt"]


@pytest.mark.slow
def test_sigterm_ends_with_a_word_and_leaves_no_temporary_files(tmp_path):
    process = subprocess.Popen(
        [CONSOLE, "run", "hospital_people", "--out", str(tmp_path / "out")],
        stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, env={"TMPDIR": str(tmp_path), "HOME": str(tmp_path)}, cwd=tmp_path,
    )  # fmt: skip
    deadline = time.monotonic() + 120
    while not list(tmp_path.glob("mrp_sumo_*")) and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    output = process.communicate(timeout=120)[1]
    assert process.returncode == 143 and "SIGTERM" in output and "Traceback" not in output
    assert not list(tmp_path.glob("mrp_sumo_*"))


@pytest.mark.parametrize(
    ("number", "output"), [(signal.SIGINT, "mrp-sumo: interrupted\n"), (signal.SIGTERM, "mrp-sumo: ended by SIGTERM\n")]
)
def test_signal_while_the_command_is_being_loaded_ends_it_with_a_line(number, output):
    code = f"""
import os, sys
class Sending:
    def find_spec(self, name, *others):
        if name == "mrp_sumo.cli.main":
            os.kill(os.getpid(), {int(number)})
sys.meta_path.insert(0, Sending())
sys.argv = ["mrp-sumo", "--version"]
from mrp_sumo.cli.start import main
sys.exit(main())"""
    ended = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True)
    assert (ended.returncode, ended.stdout, ended.stderr) == (128 + number, "", output)
    ignored = f"import signal; signal.signal({int(number)}, signal.SIG_IGN)\n{code}"
    assert subprocess.run([sys.executable, "-P", "-c", ignored], capture_output=True).returncode == 0


@pytest.mark.slow
def test_user_without_a_home_hears_nothing_of_it(tmp_path):
    nowhere = {"HOME": "/proc/nowhere", "XDG_CACHE_HOME": "/proc/nowhere", "MPLCONFIGDIR": "/proc/nowhere"}
    drawn = subprocess.run(
        [CONSOLE, "import", "office", "--out", "site"],
        cwd=tmp_path,
        env={**os.environ, **nowhere},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (drawn.returncode, drawn.stderr) == (0, "") and list(tmp_path.glob("site/**/*.png"))


@pytest.mark.parametrize("writable", [True, False])
def test_folder_in_which_kernels_cannot_be_kept_is_named_before_they_are_compiled(tmp_path, writable):
    (tmp_path / "mrp-sumo").mkdir()
    (tmp_path / "mrp-sumo").chmod(0o700 if writable else 0o777)  # where anybody can write, nothing is run
    code = "from mrp_sumo.cli.printing import warn_of_kernels; warn_of_kernels()"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "NUMBA_DISABLE_JIT": "0"}
    output = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, env=environment).stderr
    assert (
        output == ""
        if writable
        else re.fullmatch(rf"mrp-sumo: NUMBA_CACHE_DIR={re.escape(str(tmp_path))}: .*set NUMBA_CACHE_DIR.*\n", output)
    )
