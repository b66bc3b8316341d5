"""The first fleet of a map that is run by its name alone: as many robots as it has room for, on a draw that the planner solves."""

from dataclasses import replace
from itertools import product

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.solve import solve
from mrp_sumo.experiments.staging.set_up import SetUp, set_up
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.read import changed
from mrp_sumo.traffic.draw import most_drawn

STATIONS_A_ROBOT = 4  # places where robots may stand at once, for each of a first fleet
MOST = 10
SEEDS = 2  # draws that are tried with one number of robots
TRIAL_S = 1.5  # CPU time of the planner for one draw


def with_first_fleet(file: ScenarioFile, count: int | None = None, seed: int | None = None) -> tuple[ScenarioFile, str]:
    """The scenario with the first number of robots, and the first seed, of which its planner finds a plan in a few seconds.

    On narrow maps some draws ask robots to pass each other where they cannot.

    Parameters
    ----------
    file
        Of a map alone.
    count, seed
        Those of the user, where he says them. Of none that is tried, the last one stays.

    Returns
    -------
    ScenarioFile, str
        The scenario, and why a larger number was refused, '' where none was.

    Raises
    ------
    MrpSumoError
        Where not even one robot can be set up, or not as many as the user wants, with what would do.
    """
    if count is not None and seed is not None:
        return file, ""
    refused = ""
    with MapCache() as maps:
        counts = _counts(set_up(_drawn(file, 1, seed or 0), maps)) if count is None else [count]
        for robots, draw in product(counts, range(SEEDS) if seed is None else [seed]):
            chosen = _drawn(file, robots, draw)
            try:
                if _is_solved(set_up(chosen, maps)):
                    break
            except MrpSumoError as error:
                if robots in (1, count):
                    raise
                refused = str(error)
    return chosen, refused


def _counts(setup: SetUp) -> list[int]:
    """Numbers of robots that are worth a try, descending to 1."""
    robots, fleet = setup.scenario.robots, setup.problem.fleet
    room = most_drawn(setup.problem.graph, setup.scenario.seed, fleet.separation_m, anywhere=robots.draw == "anywhere")
    counts = [max(1, min(MOST, max(room // STATIONS_A_ROBOT, min(2, room // 2))))]
    while counts[-1] > 1:
        counts.append(counts[-1] // 2)
    return counts


def _is_solved(setup: SetUp) -> bool:
    """Whether the planner finds a valid plan in the time of a trial."""
    planner = setup.scenario.planner
    limited = planner.model_copy(update={"time_limit_s": min(TRIAL_S, planner.time_limit_s)})
    scenario = setup.scenario.model_copy(update={"planner": limited})
    return setup.scenario.tasks is not None or solve(replace(setup, file=replace(setup.file, scenario=scenario))).is_valid


def _drawn(file: ScenarioFile, count: int, seed: int) -> ScenarioFile:
    return changed(file, {("robots", "count"): ("--robots", count), ("seed",): ("--seed", seed)})
