"""Scripts of `tools/` that people run on files of their own."""

import csv
import importlib.util
import json
import math
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from campaigns.driver import Places
from test_architecture import tool

from mrp_sumo.calibration.log import ActionTime, LoggedOrder, MotionLog
from mrp_sumo.errors import MrpSumoError

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


def mutate():
    """The tool as a module; it needs no library until it makes mutants."""
    spec = importlib.util.spec_from_file_location("mutate", TOOLS / "mutate.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["mutate"] = module
    spec.loader.exec_module(module)
    return module


def test_the_rooms_that_are_mutated_and_the_tests_that_hold_them_are_there():
    for room, (files, tests) in mutate().ROOMS.items():
        assert all(list(TOOLS.parent.glob(file)) for file in files), room
        assert all((TOOLS.parent / test).exists() for test in tests), room


def test_mutants_that_are_listed_are_of_lines_that_are_there_and_have_reasons():
    for row in yaml.safe_load((TOOLS / "mutants.yaml").read_text()):
        lines = [line.strip() for line in (TOOLS.parent / row["file"]).read_text().splitlines()]
        assert row["before"] in lines and row["after"] != row["before"] and row["reason"], row


def test_a_mutant_is_known_by_the_lines_that_it_changes():
    assert mutate().changed_lines("a = 1\n  b = a > 2\n", "a = 1\n  b = a < 2\n") == [("b = a > 2", "b = a < 2")]


STOPPED = """
import sys
from pathlib import Path

sys.path[:0] = {path}
from campaigns import driver


class Endless:
    size = None

    def trial(self, number, folder):
        (folder / "left").touch()
        print("trial", number, flush=True)
        while number:
            pass
        return driver.Trial("first", "done")


sys.exit(driver.run(Endless(), driver.Places(sys.argv[1], 0, Path(sys.argv[2])), 60.0, 3600.0))
"""


def test_what_a_vehicle_says_of_itself_is_by_one_clock_and_orders_are_by_another(monkeypatch):
    monkeypatch.syspath_prepend(TOOLS)
    bench_calibrate = importlib.import_module("bench_calibrate")
    exact = MotionLog("run", "run folder", levels={0.0: "hall"})
    t_s = np.arange(0, 601, 0.1)
    for name, comes_s in (("a", 100.0), ("b", 300.0)):  # each drives at 1 m/s but for a service of 60 s
        x_m = t_s - np.clip(t_s - comes_s, 0, 60)
        exact.poses[name] = [(*row, 0.0, 0.0, math.nan, 0.0) for row in zip(t_s.tolist(), x_m.tolist())]
        exact.visits.append(ActionTime(name, "pick", "shelf", comes_s, comes_s + 60))
        exact.orders.append(LoggedOrder(f"of {name}", ("shelf",), 50.0, 60.0, name, ((comes_s, comes_s + 60),), comes_s + 60))
    monkeypatch.setattr(bench_calibrate, "read_fleet", lambda run: exact)
    log = bench_calibrate.observed(Path("run"), np.random.default_rng(1))
    off_s = [visit.begin_s - comes_s for visit, comes_s in zip(log.visits, (100, 300))]
    assert abs(off_s[0] - off_s[1]) > 0.5
    for visit, order, off in zip(log.visits, log.orders, off_s):
        t, x = np.array(log.poses[visit.vehicle])[:, :2].T
        at = visit.begin_s - off
        assert np.interp((visit.begin_s - 20, visit.begin_s, visit.end_s, visit.end_s + 20), t, x) == pytest.approx(
            [at - 20, at, at, at + 20], abs=0.3
        )
        assert order.services == ((visit.begin_s, visit.end_s),)
        assert (order.release_s, order.assigned_s, order.done_s) == (50.0, 60.0, at + 60)


def test_campaign_that_is_interrupted_ends_its_trial_and_says_what_was_found(tmp_path):
    tests, places = TOOLS.parent / "tests", Places(f"endless{os.getpid()}", 0, tmp_path)
    code = STOPPED.format(path=[str(tests), str(TOOLS.parent)])
    with subprocess.Popen(
        [sys.executable, "-P", "-c", code, places.name, tmp_path], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as campaign:
        assert "trial 1\n" in iter(campaign.stdout.readline, "")
        campaign.send_signal(signal.SIGINT)
        printed, said = campaign.communicate()  # which waits for the trial's process, too: it holds the pipe
    assert campaign.returncode == 0 and not said
    assert "| first | 1 | 1 | 0 | 0 | 1 done |" in printed
    assert not places.work(1).exists()


def test_plans_and_drives_are_compared_on_the_draws_that_both_have():
    questions = tool("questions")
    best = {0: (100.0, 50.0, 1.0), 1: (200.0, 80.0, 1.0), 2: (10.0, 10.0, 1.0)}
    row = questions.compared(best, {0: (110.0, 50.0, 0.1), 1: (220.0, 88.0, 0.3), 3: (1.0, 1.0, 1.0)})
    assert row["pairs"] == 2 and row["plan_percent"] == [10.0, 10.0, 10.0] and row["driven_percent"][0] == 5.0
    assert row["planner_cpu_s"] == 0.2


@pytest.mark.parametrize(("words", "line"), [("2", ""), ("1", "--seeds: found 1, expected 2 or more: fewer have no limits")])
def test_question_with_too_few_draws_is_one_line(monkeypatch, capsys, words, line):
    questions = tool("questions")
    monkeypatch.setitem(questions.QUESTIONS, "optimal", lambda options: print("asked"))
    monkeypatch.setattr(sys, "argv", ["questions.py", "optimal", "--seeds", words])
    if not line:
        assert questions.main() == 0
    else:
        with pytest.raises(SystemExit, match="2"):
            questions.main()
    output = capsys.readouterr()
    assert (output.out, output.err) == (("asked\n", "") if not line else ("", f"questions.py: {line}\n"))


def test_questions_are_answered_in_figures_and_none_is_asked_of_an_engine_that_there_is_not(monkeypatch, capsys):
    questions = tool("questions")
    row = {"planner": "ecbs", "pairs": 3, "percent": [1.84, -0.26, 3.94]}
    questions.say(row, as_json=False)
    questions.say(row, as_json=True)
    assert capsys.readouterr().out == f"| ecbs | 3 | +1.8 (-0.3 to +3.9) |\n{json.dumps(row)}\n"
    questions.require_engines("kinematic,sumo")
    with pytest.raises(MrpSumoError, match="unknown value 'kinematik'"):
        questions.require_engines("sumo,kinematik")
