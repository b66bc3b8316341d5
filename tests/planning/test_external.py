"""External planners: a command is run on an instance, its plan is read, it never outlives its time."""

import sys

import numpy as np
import pytest
from processes import gone

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.plan import Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError, ScenarioError
from mrp_sumo.formats.instances import POINT
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.planning.registry import planner
from mrp_sumo.traffic.referee import judge

PATHS = "Agent 0: (0,0)->(0,1)->(0,2)->\\nAgent 1: (1,2)->(1,1)->\\n"


@pytest.fixture
def problem():
    graph = grid_graph(np.ones((2, 3), bool), 1.0, (0.0, 0.0))  # vertices 0 1 2 are the lower row
    return Problem(graph, fleet_of(POINT, 2), np.array([3, 2]), np.array([5, 1]), np.array([0, 1]), 1.0)


def run(problem, script, time_limit_s=20.0, places="{map} {scen} {agents} {time_limit} {out}"):
    return planner("external", {"command": f'{sys.executable} -c "{script}" {places}'}).plan(problem, time_limit_s)


def test_plan_is_read_and_valid(problem):
    script = f"import sys; assert open(sys.argv[1]).read().startswith('type octile'); open(sys.argv[5], 'w').write('{PATHS}')"
    result = run(problem, script)
    assert result.status is Status.SOLVED, result.message
    assert judge(problem, result.plan).valid
    assert result.plan.end_s.tolist() == [2.0, 1.0]


def test_plan_with_conflicts_is_told_by_the_referee(problem):
    bad = "Agent 0: (0,0)->(0,1)->(0,2)->\\nAgent 1: (1,2)->(0,2)->(0,1)->(1,1)->\\n"
    result = run(problem, f"import sys; open(sys.argv[5], 'w').write('{bad}')")
    assert not judge(problem, result.plan).valid
    assert "robot_0 and robot_1" in result.message


def test_hanging_program_is_killed_with_its_children(problem, tmp_path):
    note = tmp_path / "child"
    script = (
        "import subprocess, sys, time; child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)']); "
        f"open('{note}', 'w').write(str(child.pid)); time.sleep(60)"
    )
    result = run(problem, script, time_limit_s=1.5)
    assert result.status is Status.TIMED_OUT
    assert gone(int(note.read_text()))


@pytest.mark.parametrize("left_by", ["killed", "ended"])
def test_children_in_groups_of_their_own_are_killed_too(problem, tmp_path, left_by):
    """As `timeout` makes them, which a wrapper script may use."""
    note = tmp_path / "child"
    script = (
        "import subprocess, sys, time; child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'], process_group=0); "
        f"open('{note}', 'w').write(str(child.pid)); " + ("time.sleep(60)" if left_by == "killed" else "")
    )
    result = run(problem, script, time_limit_s=1.0)
    assert result.status is (Status.TIMED_OUT if left_by == "killed" else Status.GAVE_UP)
    assert gone(int(note.read_text()))


def test_children_in_sessions_of_their_own_are_killed_too(problem, tmp_path):
    note = tmp_path / "child"
    script = (
        "import subprocess, sys, time; child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'], "
        f"start_new_session=True); open('{note}', 'w').write(str(child.pid)); time.sleep(60)"
    )
    assert run(problem, script, time_limit_s=1.0).status is Status.TIMED_OUT
    assert gone(int(note.read_text()))


def test_plan_written_before_the_kill_counts(problem):
    script = f"import sys, time; open(sys.argv[5], 'w').write('{PATHS}'); time.sleep(60)"
    result = run(problem, script, time_limit_s=1.0)
    assert result.status is Status.TIMED_OUT
    assert judge(problem, result.plan).valid
    cut_off = run(problem, script.replace("(1,1)->", "(1,"), time_limit_s=1.0)
    assert cut_off.status is Status.TIMED_OUT
    assert cut_off.plan is None


def test_program_that_assigns_is_given_free_goals(problem, tmp_path):
    """Robot 0 stands above vertex 0 and robot 1 on vertex 2: each goes to the goal that the other has in the assignment."""
    crossed = tmp_path / "crossed"
    crossed.write_text("Agent 0: (0,0)->(1,0)->(1,1)->\nAgent 1: (1,2)->(0,2)->\n")
    script = (
        "import shutil, sys; text = open(sys.argv[1]).read(); assert text.count('potentialGoals: [[2, 0], [1, 1]]') == 2, text; "
        f"shutil.copy('{crossed}', sys.argv[2])"
    )
    chosen = planner("external", {"command": f'{sys.executable} -c "{script}" {{yaml_free}} {{out}}'})
    assert chosen.assigns
    result = chosen.plan(problem, 20.0)
    assert result.status is Status.SOLVED, result.message
    assert result.goal_of.tolist() == [1, 0]
    assert judge(problem, result.plan, result.goal_of).valid


def test_solver_clock_is_read_from_the_output(problem):
    """lacam3 tells its first solution's time on a line that ends like the one before its paths."""
    text = (
        "agents=2\\nsolved=1\\ncomp_time=148\\ncomp_time_initial_solution=146\\nsolution=\\n"
        "0:(0,0),(2,1),\\n1:(1,0),(1,1),\\n2:(2,0),(1,1),\\n"
    )
    result = run(problem, f"import sys; open(sys.argv[5], 'w').write('{text}')")
    assert result.status is Status.SOLVED, result.message
    assert result.stats["own_time_s"] == 0.148
    assert 0 < result.stats["cpu_s"] < 20


def test_program_that_finds_nothing_gives_up_with_its_last_words(problem):
    result = run(problem, "print('Planning NOT successful!')")
    assert result.status is Status.GAVE_UP
    assert "exit code 0: Planning NOT successful!" in result.message


def test_rubbish_is_not_a_plan(problem):
    result = run(problem, "import sys; open(sys.argv[5], 'w').write('nonsense')")
    assert result.status is Status.GAVE_UP
    assert "not a plan in a known format" in result.message


def test_bad_commands_are_refused(problem):
    with pytest.raises(ScenarioError, match=r"unknown place '\{maps\}' \(did you mean 'map'"):
        planner("external", {"command": "solve {maps} {out}"})
    with pytest.raises(ScenarioError, match=r"no \{out\}"):
        planner("external", {"command": "solve {map}"})
    with pytest.raises(PlanError, match="cannot be started"):
        planner("external", {"command": "/no/such/program {out}"}).plan(problem, 1.0)
