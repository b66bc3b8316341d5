"""Benchmark and co-simulation of AGV fleets: maps, planners, SUMO execution, metrics, rosbags.

    import mrp_sumo as ms

    scenario = ms.Scenario(map="office", robots=9, planner="eecbs", seed=3)
    problem = ms.problem(scenario)
    plan = ms.plan(problem)
    run = ms.simulate(problem, plan, policy="adg")
    run.metrics["execution_time_s"]

The names below are loaded when they are first used: the import itself loads nothing heavy.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mrp_sumo.core.graph import NavGraph
    from mrp_sumo.core.plan import Plan, PlanResult, Status, plan_of_paths
    from mrp_sumo.door.batches import Batch, run_suite
    from mrp_sumo.door.capacity import Capacity, capacity
    from mrp_sumo.door.learning import parallel_env
    from mrp_sumo.door.maps import Site, load_map, save_map
    from mrp_sumo.door.planning import Judgement, Problem, judge, plan, problem
    from mrp_sumo.door.running import Replay, Run, load_run, run, simulate
    from mrp_sumo.door.scenario import Scenario
    from mrp_sumo.errors import MrpSumoError
    from mrp_sumo.experiments.solve import Solution
    from mrp_sumo.io.results import load_results

__version__ = "0.1.0"

_HOMES = {  # name -> module below this one
    name: home
    for home, names in {
        "core.graph": ("NavGraph",),
        "core.plan": ("Plan", "PlanResult", "Status", "plan_of_paths"),
        "door.batches": ("Batch", "run_suite"),
        "door.capacity": ("Capacity", "capacity"),
        "door.learning": ("parallel_env",),
        "door.maps": ("Site", "load_map", "save_map"),
        "door.planning": ("Judgement", "Problem", "judge", "plan", "problem"),
        "door.running": ("Replay", "Run", "load_run", "run", "simulate"),
        "door.scenario": ("Scenario",),
        "errors": ("MrpSumoError",),
        "experiments.solve": ("Solution",),
        "io.results": ("load_results",),
    }.items()
    for name in names
}

__all__ = [
    "Batch",
    "Capacity",
    "Judgement",
    "MrpSumoError",
    "NavGraph",
    "Plan",
    "PlanResult",
    "Problem",
    "Replay",
    "Run",
    "Scenario",
    "Site",
    "Solution",
    "Status",
    "__version__",
    "capacity",
    "judge",
    "load_map",
    "load_results",
    "load_run",
    "parallel_env",
    "plan",
    "plan_of_paths",
    "problem",
    "run",
    "run_suite",
    "save_map",
    "simulate",
]


def __getattr__(name: str) -> object:
    """A name of the front door, loaded from its home when it is first used."""
    if name not in _HOMES:
        from mrp_sumo.errors import nearest

        raise AttributeError(f"module 'mrp_sumo' has no attribute '{name}'{nearest(name, _HOMES) if name[0] != '_' else ''}")
    from importlib import import_module

    value = getattr(import_module(f"mrp_sumo.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
