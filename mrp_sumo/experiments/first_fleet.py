"""The number of robots for a map whose user names none: as many as it has room for, and the planner a plan."""

from dataclasses import replace

from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.solve import solve
from mrp_sumo.experiments.staging.set_up import set_up
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.read import changed
from mrp_sumo.traffic.draw import most_drawn

STATIONS_A_ROBOT = 4  # of those that robots may stand on at once
MOST = 10
TRIAL_S = 5.0  # CPU time of the planner for one number


def with_first_fleet(file: ScenarioFile) -> ScenarioFile:
    """The scenario with a number of robots that its map has room for, and its planner a plan where it finds one in a few seconds.

    Raises
    ------
    MrpSumoError
        Where not even one robot can be set up, with what would do.
    """
    with MapCache() as maps:
        setup = set_up(_with_count(file, 1), maps)
        robots = setup.scenario.robots
        room = most_drawn(setup.problem.graph, setup.scenario.seed, setup.problem.fleet.separation_m, anywhere=robots.draw == "anywhere")
        count = max(1, min(MOST, room // STATIONS_A_ROBOT))
        while count > 1 and file.scenario.tasks is None:
            setup = set_up(_with_count(file, count), maps)
            limit_s = min(TRIAL_S, setup.scenario.planner.time_limit_s)
            scenario = setup.scenario.model_copy(update={"planner": setup.scenario.planner.model_copy(update={"time_limit_s": limit_s})})
            if solve(replace(setup, file=replace(setup.file, scenario=scenario))).is_valid:
                break
            count = count * 2 // 3
    return _with_count(file, max(count, 1))


def _with_count(file: ScenarioFile, count: int) -> ScenarioFile:
    return changed(file, {("robots", "count"): ("--robots", count)})
