"""Two of a study's runs to look at, at the knee and after the collapse, and the minute of each in which traffic was slowest."""

from dataclasses import dataclass
from pathlib import Path

from mrp_sumo.experiments.run import run_scenario
from mrp_sumo.io.scenario.read import changed
from mrp_sumo.sizing.answer import Answer
from mrp_sumo.sizing.question import SATURATED, Trial
from mrp_sumo.sizing.reasons import MINUTE_S
from mrp_sumo.sizing.study import Study

KEPT = "kept"  # folder of a study


@dataclass(frozen=True)
class ReplayedRun:
    """A run that was made again, with its run folder."""

    name: str  # 'knee' or 'collapse'
    robots: int
    folder: Path
    at_s: float  # where the slowest minute begins


def keep(study: Study, answer: Answer, folder: Path) -> list[ReplayedRun]:
    """Make the first run at the knee and at the collapse again, each with its run folder. It is the same run.

    Raises MrpSumoError when a run folder cannot be written.
    """
    limits, replayed = answer.limits, []
    if limits is None:
        return []
    for name, bracket in (("knee", limits.knee), ("collapse", limits.collapse)):
        if bracket.estimate is None:
            continue
        trial, place = Trial(SATURATED, bracket.estimate, 0), folder / KEPT / name
        run_scenario(changed(study.question.file, study.values(trial)), place)
        runs = limits.curve.points[bracket.estimate].observed
        minutes = runs[0]["minutes"] if runs else []
        speed = [metres / robots if robots else 0.0 for robots, metres in minutes[1:]]
        slowest = 1 + speed.index(min(speed)) if speed else 0
        replayed.append(ReplayedRun(name, bracket.estimate, place, MINUTE_S * slowest))
    return replayed
