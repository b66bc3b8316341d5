"""Do optimised guidance graphs keep their gain when bodies are driven? `tools/guidance.py FOLDER`.

    tools/guidance.py FOLDER [--steps N] [--seeds N] [--engines kinematic,sumo] [--only NAME] [--json]

FOLDER is maps/competition of https://github.com/lunjohnzhang/ggo_public (MIT, but for its part of RHCR): grids whose cells and lanes have
costs, from Zhang et al., "Guidance Graph Optimization for Lifelong Multi-Agent Path Finding", IJCAI 2024. Robots go from errand to errand,
planned step by step with PIBT (Okumura et al., Artificial Intelligence 310, 2022), on a grid without costs, with crisscross one-way costs
by hand, and with the optimised ones; errands are the same. The plan of all steps is then driven, in its order: *steps* is what the
literature counts, errands a step; *driven* is errands a second until the first robot is at the end of its plan. Rings of robots do
not turn, since bodies cannot.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from questions import DISTURBED, MOBILE, limits, require_draws, require_engines, say
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

import mrp_sumo as ms
from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.statistics import t_mean

CASES = {  # grid: robots; costs by hand, optimised
    "warehouse 33x36": (
        220,
        "human/pibt_warehouse_33x36_w_mode_alternate_baseline_bi-directed.json",
        "ours/pibt_warehouse-33x36_w_mode_cma-es_220_agents_four-way-move.json",
    ),
    "random 32x32": (
        400,
        "human/pibt_random_unweight_32x32_alternate_baseline_bi-directed.json",
        "ours/pibt_random_cma-es_32x32_400_agents_four-way-move.json",
    ),
    "empty 48x48": (
        1000,
        "human/pibt_empty-48-48_alternate_baseline_bi-directed.json",
        "ours/pibt_empty-48-48_cma-es_1000_agents_four-way-move.json",
    ),
}
PATIENCE = 5  # steps of standing, after which a robot is last in turn
MOVES = ((0, 1), (-1, 0), (0, -1), (1, 0))  # row and column: the order of a cell's costs in the files


def main() -> int:
    """Plan, drive, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--steps", type=int, default=300, metavar="N")
    parser.add_argument("--seeds", type=int, default=5, metavar="N")
    parser.add_argument("--engines", default="kinematic,sumo", metavar="NAMES")
    parser.add_argument("--only", default="", metavar="NAME", help="of a grid")
    parser.add_argument("--json", action="store_true", help="a line a row")
    options = parser.parse_args()
    if not options.json:
        print("| grid | robots | costs | errands a step | % | engine | | errands a minute, driven | % |\n|" + "---|" * 9)
    try:
        require_draws(options.seeds)
        require_engines(options.engines)
        for name in named(options.only):
            for row in rows(name, *CASES[name], options):
                say(row, options.json)
    except FileNotFoundError as error:
        parser.exit(2, f"guidance.py: {error.filename}: no such file, expected maps/competition of ggo_public\n")
    except MrpSumoError as error:
        parser.exit(2, f"guidance.py: {error}\n")
    return 0


def named(part: str) -> list[str]:
    """Names of grids with a part. Raises MrpSumoError where there is none."""
    if names := [name for name in CASES if part in name]:
        return names
    raise MrpSumoError(f"--only: found '{part}', expected a part of {', '.join(CASES)}")


def rows(name: str, num_robots: int, by_hand: str, optimised: str, options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Figures of a grid, beside those without costs on the same errands."""
    grids = {"none": Grid(options.folder / by_hand, False), "by hand": Grid(options.folder / by_hand, True)}
    grids["optimised"] = Grid(options.folder / optimised, True)
    for run in ("undisturbed", "disturbed"):
        for engine in options.engines.split(","):
            plain: list[tuple[float, float]] = []
            for costs, grid in grids.items():
                figures = [measured(grid, num_robots, seed, engine, run, options.steps) for seed in range(options.seeds)]
                plain = plain or figures
                gains = [t_mean([100 * (f[k] / p[k] - 1) for f, p in zip(figures, plain, strict=True)]) for k in (0, 1)]
                a_step, a_second = np.array(figures).mean(0).tolist()
                yield {
                    "grid": name,
                    "robots": num_robots,
                    "costs": costs,
                    "errands_a_step": round(a_step, 2),
                    "steps_percent": limits(gains[0].value, gains[0].low, gains[0].high),
                    "engine": engine,
                    "run": run,
                    "driven_a_minute": round(60 * a_second, 1),
                    "driven_percent": limits(gains[1].value, gains[1].low, gains[1].high),
                }


class Grid:
    """A grid of a file, and what its lanes cost.

    Parameters
    ----------
    file
        JSON with `layout`, rows of characters, `@` where nobody goes, and `weights`: of waiting, one or one a cell, and of the lanes of
        each cell, in the order of `MOVES`.
    costly
        False: all lanes cost one.
    """

    def __init__(self, file: Path, costly: bool) -> None:
        content = json.loads(file.read_text())
        self.layout: list[str] = content["layout"]
        free = np.array([[character != "@" for character in row] for row in self.layout])
        number = np.where(free, np.cumsum(free).reshape(free.shape) - 1, -1)
        self.num_cells = int(free.sum())
        lanes = [
            (int(number[y, x]), int(number[y + dy, x + dx]))
            for y, x in np.argwhere(free).tolist()
            for dy, dx in MOVES
            if 0 <= y + dy < free.shape[0] and 0 <= x + dx < free.shape[1] and free[y + dy, x + dx]
        ]
        weights = content["weights"][self.num_cells if content.get("optimize_wait") else 1 :] if costly else [1.0] * len(lanes)
        if len(weights) != len(lanes):
            raise MrpSumoError(f"{file}: found {len(weights)} costs of lanes, expected {len(lanes)}")
        tail, head = np.array(lanes).T
        costs = csr_array((np.array(weights, float), (head, tail)), shape=(self.num_cells, self.num_cells))  # reversed
        self.distance: FloatArray = dijkstra(costs)  # [to, from]
        self.next_to = [[head for tail, head in lanes if tail == cell] for cell in range(self.num_cells)]
        symbols = np.array([list(row) for row in self.layout])[free]
        ends = [np.flatnonzero(symbols == kind) for kind in "we"]
        _, component = connected_components(costs)
        self.cells: IntArray = np.flatnonzero(component == np.bincount(component).argmax())  # of the largest part
        self.ends = ends if all(map(len, ends)) else [self.cells] * 2  # errands alternate between these

    def written(self, file: Path) -> None:
        """Write the grid in MovingAI's format, whose last row has the first vertices."""
        rows_ = [row.translate(str.maketrans("we", "..")) for row in self.layout[::-1]]
        file.write_text("\n".join(["type octile", f"height {len(rows_)}", f"width {len(rows_[0])}", "map", *rows_]) + "\n")


def measured(grid: Grid, num_robots: int, seed: int, engine: str, run: str, steps: int) -> tuple[float, float]:
    """Errands a step, as planned, and errands a second, as driven."""
    paths, done = planned(grid, num_robots, seed, steps)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "grid.map"
        grid.written(file)
        robots = {"starts": [f"v{v}" for v in paths[0]], "goals": [f"v{v}" for v in paths[-1]], "type": MOBILE}
        execution = {"engine": engine, "disturbances": DISTURBED if run == "disturbed" else {}}
        scenario = ms.Scenario(
            map=str(file), robots=robots, assignment={"mode": "fixed"}, execution=execution, record={"bag": False}, seed=seed
        )
        problem = ms.problem(scenario)
    driven = ms.simulate(problem, ms.plan_of_paths(list(paths.T), problem.step_s))
    if driven.status != "completed":
        raise MrpSumoError(f"seed {seed}: {driven}")
    changes = np.cumsum(np.diff(paths, axis=0, prepend=paths[:1]) != 0, axis=0)  # [steps, robots] index of the visit
    times = [group["arrived_s"].to_numpy() for _, group in driven.visits.groupby("robot", sort=False)]
    until = min(float(column[-1]) for column in times)
    if until <= 0:
        raise MrpSumoError(
            f"--steps: found {steps}, in which a robot never moves, so that nothing is driven until it is done: expected more"
        )
    served = [times[robot][changes[t, robot]] for t, robot in done]
    return len(done) / steps, float(np.count_nonzero(np.array(served) <= until)) / until


def planned(grid: Grid, num_robots: int, seed: int, steps: int) -> tuple[IntArray, list[tuple[int, int]]]:
    """[steps, robots] cells, and the step and robot of each errand that was done."""
    rng = np.random.default_rng([seed, 36])
    at = rng.permutation(grid.cells)[:num_robots].tolist()
    draws = [np.random.default_rng([seed, robot]) for robot in range(num_robots)]  # a robot's errands do not depend on the costs
    turn = [robot % 2 for robot in range(num_robots)]
    goal = [int(draws[robot].choice(grid.ends[turn[robot]])) for robot in range(num_robots)]
    since, stands, paths, done = rng.random(num_robots), np.zeros(num_robots), [list(at)], []
    for t in range(1, steps):
        before, at = at, stepped(grid, at, goal, since, rng)
        since += 1
        stands = np.where(np.equal(before, at), stands + 1, 0)
        since[stands >= PATIENCE] %= 1  # two that want past each other at a dead end take turns
        for robot in range(num_robots):
            if at[robot] == goal[robot]:
                done.append((t, robot))
                turn[robot] = 1 - turn[robot]
                goal[robot] = int(draws[robot].choice(grid.ends[turn[robot]]))
                since[robot] %= 1
        paths.append(list(at))
    return np.array(paths), done


def stepped(grid: Grid, at: list[int], goal: list[int], since: FloatArray, rng: np.random.Generator) -> list[int]:
    """Cells after a step: PIBT, the robots that have been under way longest first."""
    owner, taken, then = {cell: robot for robot, cell in enumerate(at)}, {}, [-1] * len(at)  # type: ignore[var-annotated]
    noise = rng.random(5 * len(at)).tolist()

    def move(robot: int, pushed_by: tuple[int, ...]) -> bool:
        distance = grid.distance[goal[robot]]
        cells = [*grid.next_to[at[robot]], at[robot]]
        for _, _, cell in sorted((distance[cell], noise[5 * robot + k], cell) for k, cell in enumerate(cells)):
            other = owner.get(cell)
            if cell in taken or (other is not None and other != robot and (other in pushed_by or then[other] == at[robot])):
                continue
            then[robot], taken[cell] = cell, robot
            if other is None or other == robot or then[other] >= 0 or move(other, (*pushed_by, robot)):
                return True
        then[robot], taken[at[robot]] = at[robot], robot
        return False

    for robot in np.argsort(-since, kind="stable").tolist():
        if then[robot] < 0:
            move(robot, ())
    return then


if __name__ == "__main__":
    sys.exit(main())
