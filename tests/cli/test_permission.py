"""A folder without permission: one line, exit code 2, nothing left behind.

The commands run in a process of their own, which lacks root's right to write everywhere.
"""

import json
import os
import subprocess
import sys

import pytest

from mrp_sumo.cli.main import main

DRIVER = """
import contextlib, io, json, os, sys
from mrp_sumo.cli.main import main

def call(command, folder):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(command)
    return code, err.getvalue(), sorted(os.listdir(folder))

found = [(command, *call(command, "place")) for command in json.loads(sys.argv[1])]
print(json.dumps(found))
"""
COMMANDS = (
    ["import", "small.map", "--out", "place/out"],
    ["plan", "--map", "small.map", "--scen", "small.scen", "--out", "place/plan.json"],
    ["plan", "--map", "small.map", "--scen", "small.scen", "--out", "place/plan.txt", "--format", "paths"],
    ["generate", "grid", "--vertices", "9", "--out", "place/grid.building.yaml"],
    ["convert", "small.map", "place/out.nav.yaml"],
    ["replay", "run", "--out", "place/page.html"],
    ["render", "run", "--at", "1", "--out", "place/out.png"],
    ["report", "run", "--out", "place/report.html"],
    ["export", "run", "--csv", "--out", "place/csv"],
    ["export", "run", "--bag", "--out", "place/bag"],
    ["export", "run", "--bag", "--storage", "sqlite3", "--out", "place/bag"],
    ["export", "run", "--ros1", "--out", "place/ros1.bag"],
    ["export", "run", "--geojson", "--out", "place/run.geojson"],
    ["export", "run", "--fcd", "--out", "place/fcd.xml"],
    ["run", "case.yaml", "--out", "place/out"],
    ["batch", "study.yaml", "--out", "place/batch", "--workers", "1"],
)
MAP = "type octile\nheight 2\nwidth 3\nmap\n...\n...\n"
SCEN = "version 1\n0\tsmall.map\t3\t2\t0\t0\t2\t1\t3\n0\tsmall.map\t3\t2\t2\t0\t0\t1\t3\n"
NO_RIGHTS = ("setpriv", "--bounding-set=-dac_override,-dac_read_search", "--inh-caps=-all")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "place").mkdir()
    for name, text in {"small.map": MAP, "small.scen": SCEN, "case.yaml": "map: office\nrobots: 1\n"}.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "study.yaml").write_text("base: {map: office, robots: 1}\ngrid_search: {seed: [0, 1]}\n")
    monkeypatch.chdir(tmp_path)
    assert main(["run", "case.yaml", "--out", "run"]) == 0
    return tmp_path


def driven(folder, commands, before):
    """Command, exit code, errors, and what is left, of every attempt."""
    done = subprocess.run(
        [*before, sys.executable, "-c", DRIVER, json.dumps(commands)],
        cwd=folder,
        env={**os.environ, "MPLBACKEND": "Agg"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.slow
def test_without_permission_nothing_is_written_and_one_line_says_so(folder):
    (folder / "place").chmod(0o555)
    try:
        for command, code, errors, left in driven(folder, COMMANDS, NO_RIGHTS if os.getuid() == 0 else ()):
            assert (code, len(errors.splitlines()), left) == (2, 1, []), (command, errors)
            assert "no permission" in errors, (command, errors)
    finally:
        (folder / "place").chmod(0o755)
