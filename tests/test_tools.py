"""Scripts of `tools/` that people run on files of their own."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parents[1] / "tools"
GRID = ["..@..", ".....", "..@.."]
ENDS = [((0, 0), (4, 2)), ((4, 0), (0, 2)), ((0, 1), (4, 1))]  # (column, row) of starts and goals
WAY = {"u": (0, -1), "d": (0, 1), "l": (-1, 0), "r": (1, 0), "w": (0, 0)}


def movingai(folder, *arguments):
    return subprocess.run(
        [sys.executable, TOOLS / "movingai.py", folder, "--planner", "lacam", "--step", "1", "--time-limit", "20", *arguments],
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow
def test_movingai_benchmark_goes_on_where_it_was_and_writes_plans_that_lead_to_the_goals(tmp_path):
    (tmp_path / "cross.map").write_text("type octile\nheight 3\nwidth 5\nmap\n" + "\n".join(GRID) + "\n")
    rows = [f"0\tcross.map\t5\t3\t{sx}\t{sy}\t{gx}\t{gy}\t0" for (sx, sy), (gx, gy) in ENDS]
    (tmp_path / "cross-random-7.scen").write_text("\n".join(["version 1", *rows]) + "\n")
    out = tmp_path / "out"
    assert movingai(tmp_path, "--most", "2", "--out", out).returncode == 0
    with (out / "records.jsonl").open("a") as file:
        file.write('{"cut off')
    ended = movingai(tmp_path, "--out", out)
    assert ended.returncode == 0, ended.stderr
    records = [json.loads(line) for line in (out / "records.jsonl").read_text().splitlines()]
    assert [(record["robots"], record["status"]) for record in records] == [(1, "solved"), (2, "solved"), (3, "solved")]
    assert ended.stdout.count("cross-random-7.scen") == 1  # the third; the others were known
    with (out / "solutions.csv").open(newline="") as file:
        *_, last = csv.DictReader(file)
    assert (last["map_name"], last["scen_type"], last["type_id"], last["agents"]) == ("cross", "random", "7", "3")
    moves = last["solution_plan"].split("\n")
    assert int(last["solution_cost"]) == sum(map(len, moves)) >= int(last["lower_cost"]) == 6 + 6 + 4
    for ((column, row), goal), letters in zip(ENDS, moves):
        for letter in letters:
            column, row = column + WAY[letter][0], row + WAY[letter][1]
            assert GRID[row][column] == "."
        assert (column, row) == goal
    refused = movingai(tmp_path, "--out", out, "--step", "2")
    assert refused.returncode == 2 and "choose another --out" in refused.stderr and "Traceback" not in refused.stderr
