"""Problems and solutions of the League of Robot Runners, in the formats of 2023, 2024 (Start-Kit 2.1) and 2026.

A problem is a JSON file that names a map (MovingAI, with `E` and `S` for free cells), an agents file and a tasks file, beside it. A
solution has `start` [[row, column, "E"]], `actualPaths` (one string a robot, letters F, R, C, W separated by commas),
`actualSchedule` ("time:task,..." a robot), `events` [[time, robot, task, errands done]], `tasks` [[task, time revealed, [row, column,
...]]] and `numTaskFinished`. A problem of 2023 may say in `taskAssignmentStrategy` that each robot has tasks of its own. One of 2026 also
has `agentCounter`, the ticks that an action takes, `agentSize`, and the law of delays in `delayConfig`; in its solutions, which say so in
`version`, a letter is a tick, and W one without progress. Refuses files that lack these, cells that are blocked or off the map, and tasks
without errands.
"""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.core.graph import BoolArray, IntArray, frozen
from mrp_sumo.core.step_wise import ACTION_LETTERS, HEADING_LETTERS, ActionArray, DelayLaw, StepWiseProblem, StepWiseSolution
from mrp_sumo.errors import PlanError, nearest
from mrp_sumo.files.reading import is_number, read_json, read_text
from mrp_sumo.maps.readers.movingai import free_cells

KEYS = ("mapFile", "agentFile", "taskFile", "teamSize", "numTasksReveal")
DELAYS: dict[str, tuple[Any, Any]] = {  # keys of `delayConfig`, in the order of `DelayLaw`, with what is expected
    "seed": (0, 2**31),
    "minDelay": (1, 1_000_000),
    "maxDelay": (1, 1_000_000),
    "eventModel": ("bernoulli", "poisson"),
    "pDelay": (0.0, 1.0),
    "durationModel": ("uniform", "gaussian"),
    "gaussMeanRatio": (0.0, 1.0),
    "gaussStdRatio": (0.0, 1.0),
}
STRATEGIES = ("greedy", "roundrobin")  # of 2023: any robot may have any task, or each has tasks of its own
LETTERS = b".ESG", b"@TOW"  # of free and of blocked cells
MAX_CELLS = 10_000_000
MAX_STEPS = 1_000_000


def read_problem(path: Path) -> StepWiseProblem:
    """Read a problem with its three files. Raises PlanError as the module refuses."""
    document = read_json(path, error=PlanError)
    if not isinstance(document, dict):
        raise PlanError(f"{path.name}: found {json.dumps(document):.20}, expected an object with {', '.join(KEYS)}")
    for key in KEYS:
        if key not in document:
            raise PlanError(f"{path.name}: {key} is missing{nearest(key, [other for other in document if other not in KEYS], limit=0)}")
    files = []
    for key in KEYS[:3]:
        if not isinstance(document[key], str):
            raise PlanError(f"{path.name}: {key} is {document[key]!r:.40}, expected the name of a file")
        files.append(path.parent / document[key])
    team, share = document["teamSize"], document["numTasksReveal"]
    if type(team) is not int or not 1 <= team < 10**6:
        raise PlanError(f"{path.name}: teamSize is {team!r:.20}, expected a whole number from 1 to 999999")
    if not is_number(share, 1e6) or share <= 0:
        raise PlanError(f"{path.name}: numTasksReveal is {share!r:.20}, expected a number above 0, at most 1000000")
    free = read_map(files[0])
    agents = _numbers(files[1])
    if len(agents) < team:
        raise PlanError(f"{files[1].name}: {len(agents)} robots, but teamSize is {team}")
    for line, values in agents:
        if len(values) != 1:
            raise PlanError(f"{files[1].name}:{line}: {len(values)} numbers, expected one cell")
    tasks = _numbers(files[2])
    start = np.array([values[0] for _, values in agents[:team]], np.int64)
    first = np.cumsum([0, *(len(values) for _, values in tasks)]).astype(np.int64)
    errand = np.array([cell for _, values in tasks for cell in values], np.int64)
    num_revealed = max(1, math.floor(share * team + 1e-9))
    strategy = document.get("taskAssignmentStrategy", STRATEGIES[0])
    if strategy not in STRATEGIES:
        raise PlanError(f"{path.name}: taskAssignmentStrategy is {strategy!r:.30}, expected {' or '.join(STRATEGIES)}")
    ticks, size = _of_2026(path, document)
    delays = _delays_of(path, document["delayConfig"]) if ticks and document.get("delayConfig") is not None else None
    return StepWiseProblem(
        name=path.name,
        free=frozen(free),
        start=frozen(start),
        first=frozen(first),
        errand=frozen(errand),
        num_revealed=num_revealed,
        ticks=ticks,
        size=size,
        delays=delays,
        own_tasks=strategy == STRATEGIES[1],
    )


def _of_2026(path: Path, document: dict[str, Any]) -> tuple[int, float]:
    """How many ticks an action takes, and how large a robot's square is; 0 ticks for problems of other years."""
    if "agentCounter" not in document and "2026" not in str(document.get("version", "")):
        return 0, 1.0
    ticks, size = document.get("agentCounter", 10), document.get("agentSize", 1.0)
    if type(ticks) is not int or not 1 <= ticks <= 1000:
        raise PlanError(f"{path.name}: agentCounter is {ticks!r:.20}, expected a whole number of ticks from 1 to 1000")
    if not is_number(size) or not 0 < size <= 1:
        raise PlanError(f"{path.name}: agentSize is {size!r:.20}, expected a number of cells above 0, at most 1")
    return ticks, float(size)


def _delays_of(path: Path, document: Any) -> DelayLaw:
    if not isinstance(document, dict):
        raise PlanError(f"{path.name}: delayConfig is {document!r:.40}, expected an object with {', '.join(DELAYS)}")
    values = []
    for key, expected in DELAYS.items():
        unused = key.startswith("gauss") and document.get("durationModel") == "uniform"
        if key not in document and not unused:
            raise PlanError(f"{path.name}: delayConfig.{key} is missing{nearest(key, document, limit=0)}")
        value = document.get(key, 0.0)
        if isinstance(expected[0], str):
            wrong, text = value not in expected, " or ".join(expected)
        else:
            kind = int if isinstance(expected[0], int) else int | float
            wrong = not isinstance(value, kind) or isinstance(value, bool) or not expected[0] <= value <= expected[1]
            text = f"a {'whole ' * (kind is int)}number from {expected[0]:g} to {expected[1]:g}"
        if wrong:
            raise PlanError(f"{path.name}: delayConfig.{key} is {value!r:.20}, expected {text}")
        values.append(value)
    if values[1] > values[2]:
        raise PlanError(f"{path.name}: delayConfig.minDelay is {values[1]}, expected at most maxDelay, which is {values[2]}")
    return DelayLaw(*values)


def read_solution(path: Path, problem: StepWiseProblem) -> StepWiseSolution:
    """Read a solution of a problem, which says how wide the map is.

    Raises PlanError for one that lacks what a referee needs, or has letters or numbers that mean nothing.
    """
    document = read_json(path, error=PlanError)
    if not isinstance(document, dict):
        raise PlanError(f"{path.name}: expected an object with start, actualPaths, actualSchedule, events and tasks")
    parts = {}
    for key in ("start", "actualPaths", "actualSchedule", "events", "tasks"):
        if not isinstance(document.get(key), list):
            raise PlanError(f"{path.name}: {key} is {'missing' if key not in document else 'no list'}")
        parts[key] = document[key]
    _require_rows(path, parts)
    places, paths = parts["start"], parts["actualPaths"]
    schedule = [row for r, text in enumerate(parts["actualSchedule"]) for row in _schedule_of(path, r, text)]
    done = document.get("numTaskFinished")
    if type(done) is not int:
        raise PlanError(f"{path.name}: numTaskFinished is {done!r:.20}, expected a whole number")
    return StepWiseSolution(
        start=np.array([_cell(problem, *place[:2]) for place in places], np.int64),
        heading=np.array([HEADING_LETTERS.index(place[2]) for place in places], np.int64),
        action=_actions_of(path, paths),
        schedule=_sorted(schedule, 3),
        event=_sorted(parts["events"], 4),
        released=np.array([row[1] for row in parts["tasks"]], np.int64),
        errands=tuple(tuple(_cell(problem, *pair) for pair in zip(row[2][::2], row[2][1::2])) for row in parts["tasks"]),
        num_done=done,
        in_ticks=bool(problem.ticks) and "2024" not in str(document.get("version", "")),
    )


def _require_rows(path: Path, parts: dict[str, list[Any]]) -> None:
    """Refuse lists of a solution whose rows are not what they should be."""
    num_robots = len(parts["actualPaths"])
    for key in ("start", "actualSchedule"):
        if len(parts[key]) != num_robots:
            raise PlanError(f"{path.name}: {len(parts[key])} robots in {key}, {num_robots} in actualPaths")
    for r, place in enumerate(parts["start"]):
        if not (isinstance(place, list) and len(place) == 3 and _are_whole(place[:2]) and str(place[2]) in HEADING_LETTERS and place[2]):
            raise PlanError(f"{path.name}: start[{r}] is {place!r:.40}, expected [row, column, heading of E, S, W, N]")
    for k, row in enumerate(parts["events"]):
        if not (isinstance(row, list) and len(row) == 4 and _are_whole(row)):
            raise PlanError(f"{path.name}: events[{k}] is {row!r:.40}, expected [time, robot, task, errands done]")
    for k, row in enumerate(parts["tasks"]):
        places = row[2] if isinstance(row, list) and len(row) == 3 and _are_whole(row[:2]) and row[0] == k else None
        if not (isinstance(places, list) and len(places) % 2 == 0 and _are_whole(places)):
            raise PlanError(f"{path.name}: tasks[{k}] is {row!r:.40}, expected [{k}, time, [row, column, ...]]")


def read_map(path: Path) -> BoolArray:
    """[H, W] the free cells of a map; row 0 is the uppermost. Raises PlanError for what is no MovingAI map."""
    lines = read_text(path, error=PlanError).splitlines()
    size = {}
    for words in (line.split() for line in lines[:4]):
        if len(words) == 2 and words[0] in ("height", "width") and words[1].isdecimal() and len(words[1]) < 10:
            size[words[0]] = int(words[1])
    if len(size) != 2 or len(lines) < 4 or lines[3].strip() != "map" or not 0 < size["height"] * size["width"] <= MAX_CELLS:
        raise PlanError(f"{path.name}: expected a MovingAI map: type, height, width and map in the first four lines")
    rows = lines[4 : 4 + size["height"]]
    if len(rows) < size["height"]:
        raise PlanError(f"{path.name}: {len(rows)} rows, but the header says {size['height']}")
    return free_cells(rows, 4, size["width"], LETTERS, lambda line, message: PlanError(f"{path.name}:{line}: {message}"))


def print_solution(problem: StepWiseProblem, solution: StepWiseSolution, plan_times_s: list[float]) -> str:
    """A solution as text; `plan_times_s` are the planner's of each step."""
    width = problem.free.shape[1]
    schedule: list[list[str]] = [[] for _ in range(problem.num_robots)]
    for t, r, task in solution.schedule.tolist():
        schedule[r].append(f"{t}:{task}")
    letters = np.array(list(ACTION_LETTERS))
    paths = [",".join(row) for row in letters[solution.action]]
    document = {
        "actionModel": "MAPF_T",
        "version": "2026 LoRR" if solution.in_ticks else "2024 LoRR",
        "AllValid": "Yes",
        "teamSize": problem.num_robots,
        "start": [[c // width, c % width, HEADING_LETTERS[h]] for c, h in zip(solution.start.tolist(), solution.heading.tolist())],
        "numTaskFinished": solution.num_done,
        "sumOfCost": problem.num_robots * solution.num_steps,
        "makespan": solution.num_steps,
        "actualPaths": paths,
        "plannerPaths": paths,
        "plannerTimes": [round(s, 6) for s in plan_times_s],
        "errors": [],
        "actualSchedule": [",".join(row) for row in schedule],
        "plannerSchedule": [",".join(row) for row in schedule],
        "scheduleErrors": [],
        "events": solution.event.tolist(),
        "tasks": [
            [k, t, [n for cell in cells for n in (cell // width, cell % width)]]
            for k, (t, cells) in enumerate(zip(solution.released.tolist(), solution.errands))
        ],
    }
    parts = [f"{json.dumps(key)}: {json.dumps(value, separators=(',', ':'), allow_nan=False)}" for key, value in document.items()]
    return "{\n" + ",\n".join(parts) + "\n}\n"


def _numbers(path: Path) -> list[tuple[int, list[int]]]:
    """The lines of an agents or tasks file after the count, with their numbers."""
    rows = []
    for number, line in enumerate(read_text(path, error=PlanError).splitlines(), 1):
        words = [word.strip() for word in line.split(",")]
        if line.startswith("#") or not line.strip():
            continue
        words = words[:-1] if len(words) > 1 and not words[-1] else words
        if not all(word.isdecimal() and len(word) < 16 for word in words):
            raise PlanError(f"{path.name}:{number}: '{line[:40]}', expected whole numbers separated by commas")
        rows.append((number, [int(word) for word in words]))
    if not rows or len(rows[0][1]) != 1:
        raise PlanError(f"{path.name}: expected a count in the first line")
    count = rows.pop(0)[1][0]
    if len(rows) < count:
        raise PlanError(f"{path.name}: {len(rows)} lines after the first, which says {count}")
    return rows[:count]


def _are_whole(values: list[Any]) -> bool:
    return all(type(value) is int and abs(value) < 2**31 for value in values)


def _cell(problem: StepWiseProblem, row: int, column: int) -> int:
    """A cell's number; -1 off the map."""
    height, width = problem.free.shape
    return row * width + column if 0 <= row < height and 0 <= column < width else -1


def _schedule_of(path: Path, robot: int, text: Any) -> list[tuple[int, int, int]]:
    rows = []
    for pair in str(text).split(",") if text else []:
        time, colon, task = pair.partition(":")
        if pair and not (colon and time.isdecimal() and task.removeprefix("-").isdecimal() and len(pair) < 20):
            raise PlanError(f"{path.name}: actualSchedule[{robot}] has '{pair[:20]}', expected time:task")
        if pair:
            rows.append((int(time), robot, int(task)))
    return rows


def _actions_of(path: Path, paths: list[Any]) -> ActionArray:
    rows: list[list[int]] = []
    for r, text in enumerate(paths):
        words = str(text).rstrip(",").split(",") if text else []
        wrong = [word for word in words if word not in ACTION_LETTERS or len(word) != 1]
        if wrong or len(words) > MAX_STEPS:
            raise PlanError(f"{path.name}: actualPaths[{r}] has '{wrong[0][:20] if wrong else len(words)}', expected F, R, C or W")
        if rows and len(words) != len(rows[0]):
            raise PlanError(f"{path.name}: actualPaths[{r}] has {len(words)} steps, actualPaths[0] has {len(rows[0])}")
        rows.append([ACTION_LETTERS.index(word) for word in words])
    return np.array(rows, np.int8).reshape(len(paths), -1)


def _sorted(rows: list[Any], columns: int) -> IntArray:
    table = np.array(rows, np.int64).reshape(-1, columns)
    return table[np.argsort(table[:, 0], kind="stable")]
