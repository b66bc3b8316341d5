#!/usr/bin/env python3
"""The community's MAPF benchmark: success against robots on MovingAI's maps and scenarios, and the solutions as a table.

    tools/movingai.py FOLDER --planner lacam --planner eecbs --only random-32-32 --out DIR

FOLDER has `<map>.map`, and beside it or anywhere below `<map>-even-<k>.scen` and `<map>-random-<k>.scen`; other endings count as a kind of
their own. Each planner is asked each scenario with `--step` robots, twice as many and so on, and leaves it at the first number that it does
not solve within the limit (Stern et al., SoCS 2019, section 5: 30 s; Shen et al. 2023 give a minute: `--time-limit 60`). A plan counts when
the referee finds no fault. Planners are told the limit as wall time; what they were given is no more than that of their own process.

DIR/records.jsonl has a line for each instance, written before the next begins: started again with the same DIR, the benchmark goes on.
DIR/success.png, the curves; DIR/solved.csv, them as a table; DIR/solutions.csv, the best plan of each instance, in the columns that
Shen et al. (Tracking Progress in Multi-Agent Path Finding, 2023) ask for: map_name, scen_type, type_id, agents, lower_cost, solution_cost,
solution_plan. A plan has a line for each robot, its moves u, d, l, r and w until it stays: u leads to the row above in the file;
`--flip` has it lead to the row below.
"""

import argparse
import csv
import json
import multiprocessing
import os
import re
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from time import perf_counter, process_time
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parent))
from bench_planners import made

from mrp_sumo.core.plan import Plan, Status, paths_of_plan
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.formats.instances import Instance, read_instance
from mrp_sumo.formats.peers import Cells
from mrp_sumo.maps.readers.movingai import read_problem_set
from mrp_sumo.maps.yaml_text import read_text
from mrp_sumo.search.distance import distances
from mrp_sumo.traffic.referee import judge

RECORDS = "records.jsonl"
MOVES = {(0, 0): "w", (1, 0): "r", (-1, 0): "l", (0, -1): "u", (0, 1): "d"}  # column and row, counted from the upper left corner
FLIPPED = str.maketrans("ud", "du")
COLUMNS = ("map_name", "scen_type", "type_id", "agents", "lower_cost", "solution_cost", "solution_plan")


class Ladder(NamedTuple):
    """A planner and a scenario, whose robots become more and more."""

    planner: str
    map: str
    scenario: str


def main() -> int:
    """Read the command line, and run what has not been run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--planner", action="append", required=True, help="name, or name:key=value,...; may be repeated")
    parser.add_argument("--only", default="", help="only scenarios whose name contains this text")
    parser.add_argument("--step", type=int, default=10, metavar="N", help="robots more each time (default: 10)")
    parser.add_argument("--most", type=int, default=100_000, metavar="N", help="robots at most (default: all of a scenario)")
    parser.add_argument("--time-limit", type=float, default=30.0, metavar="S", help="of an instance (default: 30)")
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="processes (default: 1; more share caches and memory)")
    parser.add_argument("--flip", action="store_true", help="u leads to the row below")
    parser.add_argument("--out", type=Path, default=Path("runs/movingai"), metavar="DIR", help="default: runs/movingai")
    options = parser.parse_args()
    if options.step < 1 or options.most < 1 or options.workers < 1 or not 0 < options.time_limit < 1e6:
        parser.error("--step, --most, --workers and --time-limit must be above 0")
    try:
        run(options)
    except MrpSumoError as error:
        print(f"movingai.py: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"movingai.py: interrupted; start it again with --out {options.out} to go on", file=sys.stderr)
        return 130
    return 0


def run(options: argparse.Namespace) -> None:
    """Climb every ladder from where it was left, then draw and write what is known."""
    scenarios = dict(scenarios_in(options.folder, options.only))
    if not scenarios:
        raise MrpSumoError(f"{options.folder}: no .scen with its .map" + (f" whose name contains '{options.only}'" if options.only else ""))
    for text in options.planner:
        made(text)  # refuses unknown names before anything runs
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / RECORDS
    records = read_records(path, options)
    known: dict[Ladder, list[dict[str, Any]]] = defaultdict(list)
    for record in records:
        known[Ladder(record["planner"], record["map"], record["scenario"])].append(record)
    ladders = [Ladder(text, scenarios[scen].stem, scen) for scen in scenarios for text in options.planner]
    with (
        path.open("a") as file,
        ProcessPoolExecutor(options.workers, multiprocessing.get_context("spawn")) as pool,
        multiprocessing.Manager() as manager,
    ):
        queue = manager.Queue()
        jobs = [
            pool.submit(climb, ladder, scenarios[ladder.scenario], options.folder / ladder.scenario, first, options, queue)
            for ladder in ladders
            if (first := next_count(known[ladder], options.step))
        ]
        try:
            for record in _arriving(jobs, queue):
                file.write(json.dumps(record) + "\n")
                file.flush()
                os.fsync(file.fileno())
                records.append(record)
                print(in_a_line(record), flush=True)
        except BaseException:
            for process in multiprocessing.active_children():  # a search ends only with its limit
                process.kill()
            raise
    write_success(records, options.out)
    num = write_solutions(records, options.out / "solutions.csv", options.flip)
    print(f"{len(records)} instances, {num} with a plan; {options.out / 'success.png'}, solved.csv, solutions.csv")


def scenarios_in(folder: Path, only: str) -> Iterator[tuple[str, Path]]:
    """Scenarios below a folder, as paths relative to it, each with its map."""
    maps = {path.stem: path for path in sorted(folder.rglob("*.map"))}
    for path in sorted(folder.rglob("*.scen")):
        named = path.name.removesuffix(".scen")
        name = next((m for m in sorted(maps, key=len, reverse=True) if named.startswith(m)), None)
        if name is not None and only in named:
            yield str(path.relative_to(folder)), maps[name]


def read_records(path: Path, options: argparse.Namespace) -> list[dict[str, Any]]:
    """What was run before. A last line that was cut off is dropped.

    Raises
    ------
    MrpSumoError
        When that was with another limit or step.
    """
    lines = path.read_text().splitlines(keepends=True) if path.exists() else []
    whole = [line for line in lines if line.endswith("\n")]
    if len(whole) < len(lines):
        path.write_text("".join(whole))
    records = [json.loads(line) for line in whole]
    for record in records[:1]:
        if (record["time_limit_s"], record["step"]) != (options.time_limit, options.step):
            raise MrpSumoError(
                f"{path}: made with --time-limit {record['time_limit_s']:g} --step {record['step']}, now {options.time_limit:g} and "
                f"{options.step}: choose another --out"
            )
    return records


def next_count(records: Sequence[dict[str, Any]], step: int) -> int:
    """With how many robots a ladder goes on; 0 where it has ended."""
    if any(record["status"] != "solved" for record in records):
        return 0
    return max((record["robots"] for record in records), default=0) + step


def climb(ladder: Ladder, map_path: Path, scen_path: Path, first: int, options: argparse.Namespace, queue: Any) -> None:
    """Plan with more and more robots, and put a record of each into `found`."""
    planner = made(ladder.planner)
    planner.prepare()
    available = len(read_problem_set(read_text(scen_path)).start)
    for robots in range(first, min(available, options.most) + 1, options.step):
        about = {**ladder._asdict(), "robots": robots, "time_limit_s": options.time_limit, "step": options.step}
        try:
            instance = read_instance(map_path, scen_path, robots)
        except MrpSumoError as error:  # two robots with one goal, as some scenarios have
            queue.put({**about, "status": "refused", "message": " ".join(str(error).split())})
            return
        record = {**about, **ask(planner, instance, options.time_limit)}
        queue.put(record)
        if record["status"] != "solved":
            return


def ask(planner: Any, instance: Instance, time_limit_s: float) -> dict[str, Any]:
    """Status, times, cost, bound and moves of one instance."""
    problem = instance.problem
    began, cpu_began = perf_counter(), process_time()
    result = planner.plan(problem, time_limit_s)
    record: dict[str, Any] = {"wall_s": perf_counter() - began, "cpu_s": result.stats.get("cpu_s", process_time() - cpu_began)}
    apart = sum(int(distances(problem.graph).to(goal)[start]) for start, goal in zip(problem.start, problem.target))
    record["bound"] = max(apart, int(-(-result.lower_bound_steps // 1)))
    if result.status is not Status.SOLVED or result.plan is None:
        return {**record, "status": result.status.value}
    if record["wall_s"] > 1.1 * time_limit_s + 1:
        return {**record, "status": "late"}
    verdict = judge(problem, result.plan, result.goal_of)
    if not verdict.valid:
        return {**record, "status": "invalid", "message": verdict.summary(problem)}
    assert instance.cells is not None
    return {**record, "status": "solved", "cost": round(result.plan.end_s.sum()), "moves": list(moves(result.plan, instance.cells))}


def moves(plan: Plan, cells: Cells) -> Iterator[str]:
    """The moves of each robot until it stays."""
    for path in paths_of_plan(plan, 1.0):
        column, row = cells.column[path], cells.row[path]
        steps = zip((column[1:] - column[:-1]).tolist(), (row[1:] - row[:-1]).tolist())
        yield "".join(MOVES[step] for step in steps).rstrip("w")


def _arriving(jobs: Iterable[Any], queue: Any) -> Iterator[dict[str, Any]]:
    """Records as they come, until all jobs are done."""
    left = set(jobs)
    while left:
        while not queue.empty():
            yield queue.get()
        for job in [job for job in left if job.done()]:
            job.result()  # raises what it raised
            left.remove(job)
        if left:
            try:
                next(as_completed(left, timeout=0.2))
            except TimeoutError:
                continue
    while not queue.empty():
        yield queue.get()


def in_a_line(record: dict[str, Any]) -> str:
    """An instance, for the terminal."""
    cost = f"cost {record['cost']} (bound {record['bound']})" if "cost" in record else record.get("message", "")
    taken = f"{record['wall_s']:.2f} s" if "wall_s" in record else ""
    return f"{record['planner']:<16} {record['scenario']:<44} {record['robots']:>5}  {record['status']:<10} {taken:>8}  {cost}"


def write_success(records: Sequence[dict[str, Any]], out: Path) -> None:
    """Curves of success against robots, one chart for each map, and the same as a table."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    solved: dict[str, dict[str, dict[str, int]]] = defaultdict(lambda: defaultdict(dict))  # map -> planner -> scenario -> most robots
    most_robots: dict[str, int] = defaultdict(int)  # map -> most robots
    for record in records:
        most_robots[record["map"]] = max(most_robots[record["map"]], record["robots"])
        of_planner = solved[record["map"]][record["planner"]]
        of_planner.setdefault(record["scenario"], 0)
        if record["status"] == "solved":
            of_planner[record["scenario"]] = max(of_planner[record["scenario"]], record["robots"])
    step = records[0]["step"] if records else 1
    columns = min(3, len(solved))
    rows = -(-len(solved) // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(4.6 * columns, 3.4 * rows), squeeze=False, sharey=True, layout="constrained")
    with (out / "solved.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(("map", "planner", "robots", "scenarios", "solved"))
        for axis, (name, by_planner) in zip(axes.flat, sorted(solved.items())):
            for planner, most in sorted(by_planner.items()):
                counts = range(step, most_robots[name] + 1, step)
                share = [sum(robots >= count for robots in most.values()) for count in counts]
                table.writerows((name, planner, count, len(most), num) for count, num in zip(counts, share))
                axis.plot(counts, [num / len(most) for num in share], marker="o", markersize=3, label=planner)
            axis.set(title=name, xlabel="robots", ylim=(-0.03, 1.03))
            axis.grid(alpha=0.3)
    for axis in axes.flat[len(solved) :]:
        axis.set_visible(False)
    for axis in axes[:, 0]:
        axis.set_ylabel("share of scenarios solved")
    axes[0, 0].legend(frameon=False)
    figure.savefig(out / "success.png", dpi=150)


def write_solutions(records: Sequence[dict[str, Any]], path: Path, flip: bool) -> int:
    """The cheapest plan of each instance, with the best of all bounds. Returns how many there are."""
    bound: dict[tuple[str, int], int] = {}
    best: dict[tuple[str, int], dict[str, Any]] = {}
    for record in records:
        instance = record["scenario"], record["robots"]
        bound[instance] = max(bound.get(instance, 0), record.get("bound", 0))
        if record["status"] == "solved" and record["cost"] < best.get(instance, {"cost": float("inf")})["cost"]:
            best[instance] = record
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        for instance, record in sorted(best.items()):
            rest = Path(record["scenario"]).stem.removeprefix(record["map"]).strip("-_")
            kind, number = re.fullmatch(r"(.*?)[-_]?(\d*)", rest).groups()  # type: ignore[union-attr]
            plan = "\n".join(record["moves"])
            row = record["map"], kind, number, record["robots"], bound[instance], record["cost"]
            table.writerow((*row, plan.translate(FLIPPED) if flip else plan))
    return len(best)


if __name__ == "__main__":
    raise SystemExit(main())
