"""The front door of environments for policies that learn; PettingZoo is loaded when one is made."""

from pathlib import Path
from typing import TYPE_CHECKING

from mrp_sumo.core.step_wise import StepWiseProblem
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.formats.lorr import read_map, read_problem
from mrp_sumo.maps.catalogue import bundled_folder, find_map

if TYPE_CHECKING:
    from mrp_sumo.door.environment import StepWiseEnv


def parallel_env(
    problem: str | Path | StepWiseProblem, *, robots: int | None = None, steps: int = 500, view: int = 5, render_mode: str | None = None
) -> "StepWiseEnv":
    """An environment of PettingZoo (`ParallelEnv`) in which every robot is an agent. Needs the extra `rl`.

    Parameters
    ----------
    problem
        A problem of the League of Robot Runners (.json), which is the same after each reset; or a MovingAI map (.map, or 'kiva' or 'mapd',
        which come with the program) on which `robots` starts and tasks of two errands are drawn at each reset.
    robots
        Of a map.
    steps
        After which all agents are truncated.
    view
        Cells that a robot sees in each direction.
    render_mode
        None, or 'ansi': `render` gives the map as text.

    Raises
    ------
    MrpSumoError
        Without PettingZoo, for what cannot be read, and for robots that do not fit.
    """
    try:
        from mrp_sumo.door.environment import StepWiseEnv, on_map
    except ImportError as error:
        raise MrpSumoError(f"parallel_env needs PettingZoo, which is not there ({error}): pip install 'mrp-sumo[rl]'") from None
    if steps < 1 or view < 1:
        raise MrpSumoError(f"parallel_env: steps is {steps} and view {view}, expected 1 or more")
    if isinstance(problem, StepWiseProblem) or Path(problem).suffix == ".json":
        if robots is not None:
            raise MrpSumoError("parallel_env: robots is for maps, a problem has its own")
        league = problem if isinstance(problem, StepWiseProblem) else read_problem(Path(problem))
        return StepWiseEnv(league, steps, view, drawn=False, render_mode=render_mode)
    bundled = bundled_folder("networks") / str(problem) / f"{problem}.map"
    path = bundled if bundled.is_file() else find_map(str(problem), Path())
    if path.suffix != ".map":
        raise MrpSumoError(f"parallel_env: '{path.name}' is neither a problem (.json) nor a MovingAI map (.map)")
    league = on_map(path.stem, read_map(path), robots or 0)
    if not robots or robots > len(league.errand):
        raise MrpSumoError(f"parallel_env: robots is {robots}, expected 1 to {len(league.errand)} on '{path.name}'")
    return StepWiseEnv(league, steps, view, drawn=True, render_mode=render_mode)
