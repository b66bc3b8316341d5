"""The first fleet of a map that is run by its name alone: as many robots as it has room for, on a draw that the planner solves."""

from collections.abc import Iterable
from dataclasses import replace

from mrp_sumo.errors import MapError, MrpSumoError
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.solve import solve
from mrp_sumo.experiments.staging.places import obstacle_between
from mrp_sumo.experiments.staging.set_up import SetUp, set_up
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.read import changed
from mrp_sumo.traffic.draw import most_drawn, stands_of

STATIONS_A_ROBOT = 4  # places where robots may stand at once, for each of a first fleet
MOST = 10
SEEDS = 2  # draws that are tried with one number of robots
DRAWS = 20  # among which those are that have somebody drive
TRIAL_S = 1.5  # CPU time of the planner for one draw


def with_first_fleet(file: ScenarioFile, count: int | None = None, seed: int | None = None) -> tuple[ScenarioFile, str]:
    """The scenario of a map alone with the first number of robots, and the first seed, of which its planner finds a plan in a few seconds.

    On narrow maps some draws ask robots to pass each other where they cannot. Numbers and seeds are those of the user, where he says them;
    of none that is tried, the last one stays. Returns why a larger number was refused, too, '' where none was. Raises MrpSumoError where
    not even one robot can be set up, or not as many as the user wants, with what would do.
    """
    if count is not None and seed is not None:
        return file, ""
    refused = ""
    with MapCache() as maps:
        one = set_up(_drawn(file, 1, seed or 0), maps)
        _require_stations(one)
        counts, draws = _counts(one) if count is None else [count], range(DRAWS) if seed is None else [seed]
        for robots in counts:
            try:
                chosen, is_solved = _first_solved(file, robots, draws, maps)
            except MrpSumoError as error:
                if robots in (1, count):
                    raise
                refused = str(error)
                continue
            if is_solved:
                break
    return chosen, refused


def _require_stations(setup: SetUp) -> None:
    """Refuse a map on which a robot could only stay where it is."""
    robots = setup.scenario.robots
    vehicle, graph, anywhere = setup.problem.fleet.types[0], setup.problem.graph, robots.draw == "anywhere"
    if len(stands_of(graph, anywhere=anywhere, vehicle=vehicle).goal) > 1:
        return
    obstacle = obstacle_between(graph, vehicle, anywhere=anywhere) if vehicle.is_vehicle else ""
    reason = (
        "; ".join([obstacle] * bool(obstacle) + [*setup.notes]) or "from no lane is there a way back (mrp-sumo import --check lists them)"
    )
    smaller = f"; a smaller type than '{setup.problem.fleet.type_name[0]}' may fit: --type" if setup.notes else ""
    turns = f" by turns that '{vehicle.name}' can make" if vehicle.is_vehicle else ""
    raise MapError(f"no two stations of '{setup.map.name}' reach each other{turns}: {reason}{smaller}")


def _first_solved(file: ScenarioFile, robots: int, draws: Iterable[int], maps: MapCache) -> tuple[ScenarioFile, bool]:
    """The first draw that the planner solves, or the last that was tried; draws by which nobody drives are passed over."""
    tried = 0
    for draw in draws:
        chosen = _drawn(file, robots, draw)
        setup = set_up(chosen, maps)
        if setup.scenario.tasks is None and set(setup.problem.start.tolist()) == set(setup.problem.goal.tolist()):
            continue
        if _is_solved(setup):
            return chosen, True
        tried += 1
        if tried == SEEDS:
            break
    return chosen, False


def _counts(setup: SetUp) -> list[int]:
    """Numbers of robots that are worth a try, descending to 1."""
    robots, fleet = setup.scenario.robots, setup.problem.fleet
    anywhere, vehicle = robots.draw == "anywhere", fleet.types[0]
    room = most_drawn(setup.problem.graph, setup.scenario.seed, fleet.separation_m, anywhere=anywhere, vehicle=vehicle)
    counts = [first_count(room, MOST)]
    while counts[-1] > 1:
        counts.append(counts[-1] // 2)
    return counts


def first_count(room: int, most: int) -> int:
    """Number of robots, at most so many, for a map that has room for so many to stand at once."""
    return max(1, min(most, max(room // STATIONS_A_ROBOT, min(2, room // 2))))


def _is_solved(setup: SetUp) -> bool:
    """True if the planner finds a valid plan in the time of a trial."""
    planner = setup.scenario.planner
    limited = planner.model_copy(update={"time_limit_s": min(TRIAL_S, planner.time_limit_s)})
    return setup.scenario.tasks is not None or solve(replace(setup, file=setup.file.having(planner=limited))).is_valid


def _drawn(file: ScenarioFile, count: int, seed: int) -> ScenarioFile:
    return changed(file, {("robots", "count"): ("--robots", count), ("seed",): ("--seed", seed)})
