"""Find out how many robots fit: knee, peak and collapse of throughput, the smallest fleet for a demand, and what binds.

The study chooses its own runs and says beforehand how long it takes. Started again with the same question and folder, it goes on where it
was; Ctrl-C ends it after the runs under way. The same question has the same answer, however often it was interrupted. Exit code 0 with an
answer, 2 for bad input, 130 or 143 when it was interrupted.
"""

import argparse
import re
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from mrp_sumo.cli import intervals, scenario_choice
from mrp_sumo.cli.batch import workers_of
from mrp_sumo.cli.ending import stoppable
from mrp_sumo.cli.option_rules import only_for, share
from mrp_sumo.cli.printing import say_either, say_progress, warn, warn_of_kernels
from mrp_sumo.errors import MrpSumoError, duration

if TYPE_CHECKING:
    from mrp_sumo.experiments.batch import Watcher
    from mrp_sumo.sizing.answer import Answer
    from mrp_sumo.sizing.question import Question
    from mrp_sumo.sizing.study import Study

UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0, "": 1.0}


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo capacity`."""
    add = parser.add_argument
    add("scenario", help="scenario file, or the name of a bundled scenario such as warehouse_lifelong")
    scenario_choice.set_argument(parser)
    add("--demand", metavar="RATE", help="orders that are to be served, such as 180/h (default: the scenario's, at its busiest)")
    add(
        "--on-time",
        metavar="SHARE",
        help="share of orders that are to be on time, such as 95%% (the default); without due times, those that take at "
        "most three times as long as in the smallest fleet; of a scenario without orders, share of draws that are to succeed "
        "(default: 80%%)",
    )
    add(
        "--robots",
        metavar="A..B",
        help="sizes of fleets (default: 4, or those of the scenario if fewer, to what the map holds, at most 200)",
    )
    add("--quick", action="store_true", help="3 seeds of 20 simulated minutes at first, wider limits, about 3 min on two cores")
    add("--budget", metavar="TIME", help="what the study may take on two cores, such as 30min, as predicted (default: 20min)")
    add("--horizon", metavar="TIME", help="simulated time of a run (default: 1h, with --quick 20min)")
    add(
        "--what-if",
        action="append",
        default=[],
        metavar="CHANGE",
        help="try a change on the same orders: 'one_way: [v3, v17]', 'doubled: [v3, v17]', 'stations.pack: +1', 'robot: amr_600', "
        "'planner: lacam', or any key; 'auto' tries the obvious ones; may be given several times",
    )
    intervals.arguments(parser)
    add("--replays", action="store_true", help="make replay pages of a run at the knee and of one at the collapse")
    add("--engine", choices=("kinematic", "sumo"), default="kinematic", help="what moves the bodies (default: kinematic)")
    add("--confirm", choices=("sumo",), help="drive knee, peak, collapse and the fleet for the demand in SUMO, too, on top of the budget")
    add("--seed", type=int, metavar="N", help="first seed (default: the scenario's)")
    add("--json", action="store_true", help="print the answer as JSON")
    add("--out", metavar="DIR", help="folder of runs and page (default: runs/capacity_<scenario>)")
    add("--workers", type=int, metavar="N", help="processes (default: one a core)")
    add("--scheduler", metavar="ADDRESS", help="let the workers of this Dask scheduler make the runs")
    add("--dry-run", action="store_true", help="say how long it would take; run nothing")
    add("--trust", action="store_true", help="run the programs that the scenario names")


def run(options: argparse.Namespace) -> int:
    """Make the study, write its page, print the answer."""
    from mrp_sumo.plugins.trust import trust_everything

    if options.dry_run:
        only_for("an answer: leave it out with --dry-run", json=options.json, replays=options.replays)
    trust_everything(options.trust)
    workers = workers_of(options)
    if options.out and Path(options.out).is_file():  # said before anything large is loaded
        raise MrpSumoError(f"{options.out}: is a file, expected a folder for the study")
    question = question_of(options)
    from mrp_sumo.experiments.batch import Making, require_ours
    from mrp_sumo.sizing.study import Study

    study = Study(question)
    warn_of_kernels()
    folder = Path(options.out) if options.out else Path("runs") / study.variations.suite.name
    if folder.exists():
        require_ours(folder, study.variations.suite.name, study.variations.code)  # before the pilot run
    warn(f"{_beforehand(study)}; into {folder}")
    if options.dry_run:
        return 0
    with stoppable() as stop:
        answer = study.run(folder, _watcher(), Making(workers, options.scheduler, stop=stop))
    if answer is None:
        return stop.interrupted(options.command_line)
    from mrp_sumo.reports.capacity.page import write_capacity_page
    from mrp_sumo.sizing.replays import keep

    page = write_capacity_page(study, answer, folder, keep(study, answer, folder) if options.replays else ())
    say_either(options.json, answer.document, *_in_words(study, answer, page), indent=2)
    return 0


def question_of(options: argparse.Namespace) -> "Question":
    """The question that the command line asks. Raises MrpSumoError: one line, for what cannot be read."""
    from mrp_sumo.io.scenario.file import find_scenario
    from mrp_sumo.io.scenario.read import read_scenario

    robots = _sizes(options.robots) if options.robots else None
    demand_per_h = _rate_per_h(options.demand) if options.demand else None
    on_time = share("--on-time", options.on_time, 1e-6, 1 - 1e-6) if options.on_time else 0.0
    budget_s = _duration_s("--budget", options.budget) if options.budget else None
    horizon_s = _duration_s("--horizon", options.horizon) if options.horizon else None
    if not all(text.strip() for text in options.what_if):
        raise MrpSumoError("--what-if: found nothing, expected a key and a value, such as 'planner: lacam' or 'stations.pack: +1'")
    scenario_choice.require_scenario(options.scenario)
    file = scenario_choice.with_set(options, read_scenario(find_scenario(options.scenario)))
    if horizon_s and file.scenario.tasks is None:
        raise MrpSumoError(
            f"--horizon: '{file.scenario.name}' has no orders: its runs end once all robots are at their goals; leave it out"
        )
    from mrp_sumo.sizing.question import AS_MANY_AS_FIT, Question, effort_of  # loads arrays: after all that can be told without

    bounds = intervals.bounds_of(options, file)
    return Question(
        file,
        sizes=robots or AS_MANY_AS_FIT,
        effort=effort_of(options.quick, budget_s, horizon_s),
        demand_per_h=demand_per_h,
        share=on_time,
        engine=options.engine,
        first_seed=file.scenario.seed if options.seed is None else options.seed,
        what_if=tuple(options.what_if),
        confirm=options.confirm == "sumo",
        bounds=None if bounds is None else tuple(bounds.items()),
        command=_command(options),
    )


def _sizes(text: str) -> tuple[int, int]:
    from mrp_sumo.sizing.question import require_sizes

    match = re.fullmatch(r"(\d{1,6})\.\.(\d{1,6})", text)
    if not match:
        raise MrpSumoError(f"--robots {text}: expected the least and the most, such as 5..60")
    low, high = int(match[1]), int(match[2])
    require_sizes(low, high)
    return low, high


def _command(options: argparse.Namespace) -> str:
    """The command line that asks the same, whatever it is asked with."""
    parts = ["mrp-sumo", "capacity", options.scenario]
    for pair in options.set:
        parts += ["--set", pair]
    for name in ("demand", "on_time", "robots", "budget", "horizon", "confirm", "seed"):
        if (value := getattr(options, name)) is not None:
            parts += [f"--{name.replace('_', '-')}", str(value)]
    parts += ["--error-bands"] * options.error_bands
    for text in options.interval:
        parts += ["--interval", text]
    parts += ["--intervals", str(options.intervals)] if options.intervals else []
    parts += ["--quick"] * options.quick + ["--trust"] * options.trust
    parts += ["--engine", options.engine] if options.engine != "kinematic" else []
    for text in options.what_if:
        parts += ["--what-if", text]
    return shlex.join(parts)


def _duration_s(option: str, text: str) -> float:
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*(s|min|h|)", text)
    if not match or float(match[1]) <= 0:
        raise MrpSumoError(f"{option} {text}: expected a time such as 30min, 2h or 90s")
    return float(match[1]) * UNITS[match[2]]


def _rate_per_h(text: str) -> float:
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*(?:/\s*(h|min|s))?", text)
    if not match or float(match[1]) <= 0:
        raise MrpSumoError(f"--demand {text}: expected orders in a time, such as 180/h")
    return float(match[1]) * 3600 / UNITS[match[2] or "h"]


def _beforehand(study: "Study") -> str:
    estimate = study.estimate
    from mrp_sumo.sizing.question import CORES

    sizes = ", ".join(map(str, estimate.sizes))
    bands = f", then about {duration(estimate.bands_s)} for error bands" if estimate.bands_s else ""
    confirmed = f", then at most {duration(estimate.confirm_s)} to confirm it in SUMO" if estimate.confirm_s else ""
    if not estimate.sizes:
        return f"{duration(estimate.budget_s)} are hardly enough: they end the runs of the first fleets under way"
    how = f", by a pilot run with {study.pilot.robots}" if study.question.has_tasks else ""
    return (
        f"about {duration(estimate.grid_s)} on {CORES} cores for fleets of {sizes}{how}; with all that follows at most "
        f"{duration(estimate.budget_s)}, which end runs under way{confirmed}{bands}"
    )


def _in_words(study: "Study", answer: "Answer", page: Path) -> list[str]:
    from mrp_sumo.sizing.reasons import in_words

    lines = [answer.sentence, *(f"note: {note}" for note in answer.notes)]
    if limit := answer.limit:
        lines.append(f"What binds: {in_words(limit, study.nav)}.")
    for gain in answer.gains:
        mean = gain.difference.difference
        gained = f"{mean.value:+.1f} orders an hour ({mean.low:+.1f} to {mean.high:+.1f})"
        lines.append(f"What if {gain.change}: " + (f"cannot be, {gain.refusal}" if gain.refusal else gained) + ".")
    lines += [answer.bands.sentence] if answer.bands else []
    for size in answer.confirmed:
        mean = size.difference.difference
        lines.append(
            f"SUMO {'confirms' if size.agrees else 'does not confirm'} the {size.name} at {size.robots}: {size.measure} "
            f"{size.difference.second:.4g}, {size.difference.first:.4g} without it ({mean.low:+.3g} to {mean.high:+.3g})."
        )
    return [*lines, f"{page}"]


def _watcher() -> "Watcher":
    """A line on a terminal that says how far the study is; in a pipe, warnings only."""
    from mrp_sumo.experiments.batch import Watcher

    class StudyLine(Watcher):
        def report(self, line: str) -> None:
            warn(line)

        def show(self) -> None:
            say_progress(f"{self.num_done} of {self.num_runs} runs, more as they are needed ")

    return StudyLine()
