"""Questions that simulators are asked, answered by one command each: `tools/questions.py NAME`.

    tools/questions.py optimal [--seeds N] [--robots N] [--map NAME] [--engines kinematic,sumo] [--json]
    tools/questions.py dispatch [--seeds N] [--engines kinematic,sumo] [--json]
    tools/questions.py speeds [--seeds N] [--robots N] [--map NAME] [--engines kinematic,sumo] [--json]

`optimal`: is an optimal plan worth it once it is driven? CBS, whose plans have the least sum of costs, beside planners that are bounded
and fast, on the same draws: by how much planned sums of costs and driven flowtimes are above CBS's, mean of pairs with Student's limits
of 95 %; pairs are draws on which both have a plan that is driven to the end. *Disturbed*: robots lose speed (`speed_noise` 0.1) and stop at
random (once in 200 s, for 3 s). CBS has 4 CPU-s for a plan, so that draws with many conflicts are left out.

`dispatch`: is round robin near the best dispatcher once robots have bodies? Orders an hour and lead times on bundled scenarios with work,
by dispatcher, beside `nearest` on the same orders. *Busy*: two orders a robot are open at any time; else they come as the scenario says.

`speeds`: how wrong may speed and acceleration be before the planners' ranking turns? Plans are made for robots whose top speed,
acceleration or turn rate is a factor off, and driven by the true ones in the plan's order; and plans for robots that are alike, driven by
robots that are up to 30 % slower, each its own share. Driven flowtimes beside those of `lacam` on the same draws, whose plans count steps
and so know no speed.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from typing import Any

import mrp_sumo as ms
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.statistics import t_mean

OPTIMAL, OTHERS = "cbs", ("ecbs", "lacam", "prioritised")
WORK = {"warehouse_lifelong": 8, "plant_lifelong": 5}  # robots
DISPATCHERS = ("nearest", "round_robin", "token_passing", "hungarian")
DISTURBED = {"speed_noise": 0.1, "stops_per_s": 0.005}
IN_STEPS, IN_SECONDS = ("lacam", "ecbs", "prioritised"), ("continuous",)
FACTORS = (0.25, 0.5, 2.0, 4.0)  # of what the planner believes beside the truth
SPREAD = 0.3
MOBILE = {  # a small mobile robot, slow enough in speeding up and turning that both matter
    "length_m": 0.35,
    "width_m": 0.25,
    "max_speed_mps": 0.8,
    "accel_mps2": 0.5,
    "decel_mps2": 0.5,
    "turn_rate_rad_s": 0.8,
    "gap_m": 0.05,
}
BELIEFS = ("max_speed_mps", "accel_mps2", "turn_rate_rad_s")
Figures = dict[int, tuple[float, float, float]]  # by seed: sum of costs in steps, flowtime as driven, CPU time of the planner


def main() -> int:
    """Ask, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("question", choices=QUESTIONS)
    parser.add_argument("--seeds", type=int, default=10, metavar="N")
    parser.add_argument("--robots", type=int, default=24, metavar="N")
    parser.add_argument("--map", default="hospital", metavar="NAME")
    parser.add_argument("--engines", default="kinematic,sumo", metavar="NAMES")
    parser.add_argument("--json", action="store_true", help="a line a row")
    options = parser.parse_args()
    try:
        require_draws(options.seeds)
        require_engines(options.engines)
        QUESTIONS[options.question](options)
    except MrpSumoError as error:
        parser.exit(2, f"questions.py: {error}\n")
    return 0


def require_draws(seeds: int) -> None:
    """Raises MrpSumoError for fewer draws than limits can be taken of."""
    if seeds < 2:
        raise MrpSumoError(f"--seeds: found {seeds}, expected 2 or more: fewer have no limits")


def require_engines(names: str) -> None:
    """Raises MrpSumoError for an engine that there is not, before the first of them has driven for long."""
    for name in names.split(","):
        ms.Scenario(map="hospital", robots={"count": 1}, execution={"engine": name})


def optimal(options: argparse.Namespace) -> None:
    """Planners beside CBS."""
    if not options.json:
        print("| planner | engine | | pairs | plan, % above | driven, % above | planner's CPU-s |\n|---|---|---|---|---|---|---|")
    for engine in options.engines.split(","):
        for word, disturbances in (("undisturbed", {}), ("disturbed", DISTURBED)):
            best = driven(OPTIMAL, engine, disturbances, options)
            for name in (OPTIMAL, *OTHERS):
                row = compared(best, best if name == OPTIMAL else driven(name, engine, disturbances, options))
                say({"planner": name, "engine": engine, "run": word, **row}, options.json)


def dispatch(options: argparse.Namespace) -> None:
    """Dispatchers beside `nearest`."""
    if not options.json:
        print("| scenario | engine | | dispatcher | runs | orders an hour | % above nearest | lead time, s |\n|" + "---|" * 8)
    for name, robots in WORK.items():
        for engine in options.engines.split(","):
            for busy in (False, True):
                nearest = worked(name, robots, "nearest", engine, busy, options.seeds)
                for dispatcher in DISPATCHERS:
                    mine = nearest if dispatcher == "nearest" else worked(name, robots, dispatcher, engine, busy, options.seeds)
                    pairs = sorted(nearest.keys() & mine.keys())
                    above = t_mean([100 * (mine[seed][0] / nearest[seed][0] - 1) for seed in pairs])
                    rate, lead = (sum(mine[seed][k] for seed in pairs) / max(len(pairs), 1) for k in (0, 1))
                    row = {"scenario": name, "engine": engine, "run": "busy" if busy else "", "dispatcher": dispatcher, "runs": len(pairs)}
                    row |= {"orders_an_hour": round(rate, 1), "percent": limits(above.value, above.low, above.high)}
                    say({**row, "lead_time_s": round(lead, 1)}, options.json)


def speeds(options: argparse.Namespace) -> None:
    """Planners that believe wrong figures, beside `lacam`."""
    if not options.json:
        print("| planner | engine | robots | believed | draws | driven, % above lacam |\n|" + "---|" * 6)
    for engine in options.engines.split(","):
        for slow in (False, True):
            best = believed("lacam", {}, engine, slow, options)
            for name in (*IN_STEPS[1:], *IN_SECONDS):
                wrong = [{key: factor} for key in BELIEFS for factor in FACTORS] if name in IN_SECONDS and not slow else []
                for belief in ({}, *wrong):
                    figures = believed(name, belief, engine, slow, options)
                    pairs = sorted(best.keys() & figures.keys())
                    mean = t_mean([100 * (figures[seed] / best[seed] - 1) for seed in pairs])
                    row = {
                        "planner": name,
                        "engine": engine,
                        "robots": "up to 30 % slower" if slow else "alike",
                        "believed": ", ".join(f"{key} x {factor:g}" for key, factor in belief.items()) or "alike",
                        "draws": len(pairs),
                        "percent": limits(mean.value, mean.low, mean.high),
                    }
                    say(row, options.json)


def believed(name: str, belief: dict[str, float], engine: str, slow: bool, options: argparse.Namespace) -> dict[int, float]:
    """Driven flowtime in s, by seed, of plans for robots that the planner believes to be other than they are."""
    figures = {}
    for seed in range(options.seeds):
        keys: dict[str, Any] = {
            "map": options.map,
            "seed": seed,
            "planner": {"name": name, "time_limit_s": 4.0},
            "assignment": {"mode": "fixed"},
            "execution": {"engine": engine},
            "record": {"bag": False},
        }
        robots = {"count": options.robots, "draw": "anywhere", "type": MOBILE}
        truth = ms.problem(ms.Scenario(**keys, robots=robots))
        plan = ms.plan(ms.problem(ms.Scenario(**keys, robots={**robots, "factor": belief})) if belief else truth)
        if not plan.is_valid:
            continue
        uneven = {"disturbances": {"speed_spread": SPREAD}} if slow else {}
        metrics = ms.simulate(truth, plan, **uneven).metrics
        if metrics["all_goals_reached"] and metrics["driven_flowtime_s"] is not None:
            figures[seed] = metrics["driven_flowtime_s"]
    return figures


def worked(name: str, robots: int, dispatcher: str, engine: str, busy: bool, seeds: int) -> dict[int, tuple[float, float]]:
    """Orders an hour and mean lead time in s, by seed, of runs that count."""
    figures = {}
    for seed in range(seeds):
        scenario = ms.Scenario.read(name).replace(
            robots={"count": robots, "draw": "anywhere"},
            seed=seed,
            execution={"dispatcher": dispatcher, "engine": engine},
            record={"bag": False},
            **({"tasks": {"open": 2 * robots}} if busy else {}),
        )
        result = ms.run(scenario)
        if result.result["status"] == "completed":  # and so passed by both audits
            figures[seed] = result.metrics["throughput_per_h"], result.metrics["lead_time_mean_s"]
    return figures


def driven(planner: str, engine: str, disturbances: dict[str, float], options: argparse.Namespace) -> Figures:
    """Figures of the draws whose plan is driven to the end."""
    figures: Figures = {}
    for seed in range(options.seeds):
        scenario = ms.Scenario(
            map=options.map,
            robots={"count": options.robots, "draw": "anywhere"},
            seed=seed,
            planner={"name": planner, "time_limit_s": 4.0},
            execution={"engine": engine, "disturbances": disturbances},
            record={"bag": False},
        )
        metrics = ms.run(scenario).metrics
        if metrics["all_goals_reached"] and metrics["driven_flowtime_s"] is not None:
            figures[seed] = metrics["soc_steps"], metrics["driven_flowtime_s"], metrics["planning_cpu_s"]
    return figures


def compared(one: Figures, other: Figures) -> dict[str, object]:
    """By how much the second is above the first, in per cent, on the draws that both have."""
    pairs = sorted(one.keys() & other.keys())
    above = [[100 * (other[seed][k] / one[seed][k] - 1) for seed in pairs] for k in (0, 1)]
    plan, drive = (t_mean(values) for values in above)
    return {
        "pairs": len(pairs),
        "plan_percent": limits(plan.value, plan.low, plan.high),
        "driven_percent": limits(drive.value, drive.low, drive.high),
        "planner_cpu_s": round(sum(other[seed][2] for seed in pairs) / max(len(pairs), 1), 3),
    }


def limits(*figures: float) -> Sequence[float]:
    """Mean, low and high, rounded."""
    return [round(figure, 2) for figure in figures]


def say(row: dict[str, Any], as_json: bool) -> None:
    """Print a row of the table, with lists of a mean and its limits as people write them, or as JSON."""
    cells = ["{:+.1f} ({:+.1f} to {:+.1f})".format(*cell) if isinstance(cell, list) else str(cell) for cell in row.values()]
    print(json.dumps(row) if as_json else f"| {' | '.join(cells)} |", flush=True)


QUESTIONS = {"optimal": optimal, "dispatch": dispatch, "speeds": speeds}

if __name__ == "__main__":
    sys.exit(main())
