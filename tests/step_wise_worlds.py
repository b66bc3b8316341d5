"""Small step-wise worlds, and solutions that no planner made."""

import json

import numpy as np

from mrp_sumo.core.step_wise import FORWARD, RIGHT, StepWiseProblem
from mrp_sumo.planning.step_wise import Decision, run_step_wise

ROUND = ("...", ".@.", "...")  # a ring of eight cells


def problem_of(rows, start, tasks, num_revealed=None):
    """A problem on a map of '.' and '@'; tasks are lists of cells."""
    free = np.array([[c == "." for c in row] for row in rows])
    first = np.cumsum([0, *map(len, tasks)])
    errand = np.array([cell for cells in tasks for cell in cells])
    return StepWiseProblem("small", free, np.array(start), first, errand, num_revealed or len(start))


def write_problem(folder, rows, start, tasks, **keys):
    """The same as files; returns the problem's path."""
    (folder / "x.map").write_text(f"type octile\nheight {len(rows)}\nwidth {len(rows[0])}\nmap\n" + "\n".join(rows) + "\n")
    (folder / "x.agents").write_text("\n".join(map(str, [len(start), *start])) + "\n")
    (folder / "x.tasks").write_text("\n".join([str(len(tasks)), *(",".join(map(str, cells)) for cells in tasks)]) + "\n")
    document = {"mapFile": "x.map", "agentFile": "x.agents", "taskFile": "x.tasks", "teamSize": len(start), "numTasksReveal": 1.0}
    path = folder / "x.json"
    path.write_text(json.dumps(document | keys))
    return path


class RoundAndRound:
    """All robots go round the ring to the right, turning together; free robots take tasks in order."""

    def prepare(self):
        pass

    def begin(self, problem, seed):
        return self

    def step(self, seen):
        n = seen.problem.num_robots
        inside = np.array([_ahead_is_free(seen, r) for r in range(n)])
        action = np.full(n, FORWARD if inside.all() else RIGHT)
        if not inside.all():
            action[inside] = 3
        task_of, waiting = seen.task_of.copy(), [k for k in seen.pool if k not in seen.task_of]
        for r in np.flatnonzero(task_of < 0):
            if waiting:
                task_of[r] = waiting.pop(0)
        return Decision(action, task_of)


def _ahead_is_free(seen, r):
    row, column = divmod(int(seen.cell[r]), 3)
    row, column = row + (0, 1, 0, -1)[seen.heading[r]], column + (1, 0, -1, 0)[seen.heading[r]]
    return 0 <= row < 3 and 0 <= column < 3 and bool(seen.problem.free[row, column])


def solution_of(problem, num_steps):
    """What robots going round do."""
    return run_step_wise(problem, RoundAndRound(), num_steps).solution
