"""MRP-Bench's execution metrics of a bag with /fleet_states: ours, or one that MRP-Bench recorded.

Starts, goals and constants are taken from --config, else from the YAML file beside the bag (as MRP-Bench
leaves it), else from the metadata of a bag of ours and from the bag's /robot_path_requests. BAG may be a run
folder, too. Options win over files.

With --metric, BAG is a run folder or the folder of a batch, and the metrics are those that are named: bundled ones, or
FILE.py:FUNCTION of your own. A batch's results get them as columns.

With --audit, BAG is a run folder, and bodies and work are judged again by its tables as they are now. Exit code 1 for findings.
"""

import argparse
import math
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrp_sumo.cli.option_rules import only_for
from mrp_sumo.cli.printing import say, say_either, say_json, warn

if TYPE_CHECKING:
    from mrp_sumo.metrics.metric import Metric

DEFAULTS = {"cellSize": 0.35, "locationTolerance": 0.7, "windowSize": 10, "recordingTimeout": 600.0}
OPTIONS = dict(zip(DEFAULTS, ("cell", "tolerance", "window", "timeout")))
ROWS = {
    "messages": "",
    "period": "s",
    "numGoals": "",
    "maxRobotsSeen": "",
    "goalsReached": "",
    "allGoalReached": "",
    "executionTimeoutReached": "",
    "totalTimeForScheduleExecution": "s",
    "timeBlockedTotal": "s",
    "minDistanceBetweenTwoAgents": "m",
    "minDistanceBetweenTwoAgentsAtStart": "m",
    "minDistanceBetweenTwoAgentsDelta": "m",
    "invalidRun": "",
}


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo analyze`."""
    parser.add_argument("bag", metavar="BAG", type=Path, help="bag folder or file, or a run folder")
    parser.add_argument("--config", metavar="FILE", type=Path, help="YAML or JSON with starts, goals and constants")
    parser.add_argument("--rmf", metavar="NAME", help="generation of rmf_fleet_msgs: galactic, jazzy or kilted (default: found out)")
    parser.add_argument("--cell", dest="cellSize", type=float, metavar="M", help="MRP-Bench's cellSize (default: 0.35)")
    parser.add_argument("--tolerance", dest="locationTolerance", type=float, metavar="M", help="its locationTolerance (default: 0.7)")
    parser.add_argument("--window", dest="windowSize", type=int, metavar="N", help="its windowSize (default: 10)")
    parser.add_argument("--timeout", dest="recordingTimeout", type=float, metavar="S", help="its recordingTimeout (default: 600)")
    parser.add_argument("--metric", action="append", metavar="NAME", help="compute this metric of a run or a batch; may be repeated")
    parser.add_argument("--audit", action="store_true", help="judge bodies and work of a run again, by the tables in its folder")
    parser.add_argument("--json", action="store_true", help="print JSON, all keys by MRP-Bench's names")


def run(options: argparse.Namespace) -> int:
    """Print the metrics."""
    from mrp_sumo.errors import MrpSumoError

    if options.audit or options.metric:
        if options.audit and options.metric:
            raise MrpSumoError("--audit and --metric: expected one of them")
        only_for("MRP-Bench's metrics, without --metric and --audit", **_said(options))
        return (_audit if options.audit else _measure)(options)
    metrics = analysed(options.bag, options.config, options.rmf, {key: getattr(options, key) for key in DEFAULTS})
    from mrp_sumo.io.tasks_table import TASKS

    if (options.bag / TASKS).is_file():
        warn(f"{options.bag}: a run with orders, which MRP-Bench's metrics do not count: `mrp-sumo report` shows its own figures")
    if options.json:
        say_json(metrics, indent=2)
        return 0
    for key, unit in ROWS.items():
        value = metrics[key]
        text = "-" if value is None else f"{value:.3f} {unit}" if isinstance(value, float) else f"{value} {unit}"
        say(f"{key:35} {text}".rstrip())
    blocked = sorted((v, k) for k, v in metrics["timeBlockedPerAgent"].items() if v > 0)
    for value, name in blocked[::-1][:10]:
        say(f"  blocked {name:25} {value:.3f} s")
    return 0


def _said(options: argparse.Namespace) -> dict[str, object]:
    return {"config": options.config, "rmf": options.rmf, **{option: getattr(options, key) for key, option in OPTIONS.items()}}


def _audit(options: argparse.Namespace) -> int:
    """Judge a run again by its tables: bodies, and work where there is any. Exit code 1 when something is found."""
    from mrp_sumo.experiments.audit_work import logs_in
    from mrp_sumo.io.run_folder import plain
    from mrp_sumo.io.run_reader import load_run
    from mrp_sumo.metrics.audit import audit, first_findings
    from mrp_sumo.metrics.operations.audit import operations_audit

    run = load_run(options.bag)
    level = None if run.plan is None else run.graph.level[run.plan.vertex[run.plan.first[:-1]]]
    findings = [finding._asdict() for finding in first_findings(audit(run.execution, run.fleet, level))]
    logs = logs_in(run)
    if logs is not None:
        findings += operations_audit(logs)["findings"]
    passed = f"{options.bag}: audit of bodies {'passed, a run without orders' if logs is None else 'and operations audit passed'}"
    lines = [f"{finding['t_s']:10.2f} s  {finding['rule']}: {finding['text']}" for finding in findings]
    say_either(options.json, plain({"passed": not findings, "findings": findings}), *(lines or [passed]), indent=2)
    return 1 if findings else 0


def _measure(options: argparse.Namespace) -> int:
    """Compute metrics of a run, or of a batch, from what their folders keep. Exit code 1 when one failed."""
    from mrp_sumo.experiments.measure_later import measure_run
    from mrp_sumo.files.folders import is_batch
    from mrp_sumo.io.run_reader import load_run

    if is_batch(options.bag):
        return measure_named(options.bag, options.metric, as_json=options.json)
    metrics, faults = named_metrics(options.metric)
    values = measure_run(load_run(options.bag), metrics)
    say_either(options.json, values, *(f"{m.name:35} {values[m.name]} {m.unit}".rstrip() for m in metrics), indent=2)
    return _failed(faults)


def measure_named(folder: Path, names: list[str], quiet: bool = False, as_json: bool = False) -> int:
    """Compute metrics of all runs of a batch. Exit code 1 when one failed."""
    from mrp_sumo.experiments.measure_later import measure_batch

    metrics, faults = named_metrics(names)
    num_measured, num_runs = measure_batch(folder, metrics, faults.append)
    if as_json:
        say_json({"metrics": [m.name for m in metrics], "measured": num_measured, "runs": num_runs})
    elif not quiet:
        say(f"{folder}: {', '.join(m.name for m in metrics)} of {num_measured} of {num_runs} runs, in results.parquet and results.csv")
    return _failed(faults)


def named_metrics(names: list[str]) -> "tuple[list[Metric], list[str]]":
    """The metrics of these names, and where lines about those that fail are gathered."""
    from mrp_sumo.cli.scenario_choice import trust_named
    from mrp_sumo.metrics.own import guarded

    for name in names:
        trust_named(name)
    faults: list[str] = []
    return [guarded(name, None, lambda error: faults.append(str(error))) for name in names], faults


def _failed(faults: list[str]) -> int:
    for line in dict.fromkeys(faults):
        warn(line)
    return 1 if faults else 0


def analysed(bag: Path, config: Path | None, generation: str | None, overrides: dict[str, float | None]) -> dict[str, Any]:
    """The metrics of a bag; `overrides` win over constants of files. Raises MrpSumoError when something is missing, in one line."""
    from mrp_sumo.errors import MrpSumoError, nearest
    from mrp_sumo.files.folders import is_batch

    if not bag.exists():  # said before anything large is loaded
        raise MrpSumoError(f"{bag}: no such bag")
    if is_batch(bag):
        raise MrpSumoError(f"{bag}: a batch, expected a bag or a run; add --metric NAME, or see `mrp-sumo report {shlex.quote(str(bag))}`")
    chosen = {key: value for key, value in overrides.items() if value is not None}
    for key, value in chosen.items():
        if not 0 < value < math.inf:
            raise MrpSumoError(f"--{OPTIONS[key]}: found {value:g}, expected a number above 0")
    import numpy as np

    from mrp_sumo.bags.reader import read_fleet_log
    from mrp_sumo.metrics.mrp_bench import AnalyserConstants, execution_metrics

    folder = _folder_of(bag)
    constants, places = _recorded(folder, config)
    log = read_fleet_log(folder, generation)
    constants = DEFAULTS | constants | chosen
    for key, value in constants.items():
        if not 0 < value < math.inf:
            raise MrpSumoError(f"{key} is {value}, expected a number above 0")
    places = places or log.requests
    if not places:
        raise MrpSumoError(f"{folder}: no starts and goals beside it and no /robot_path_requests in it; give them with --config")
    if (name := next((name for name in log.robot_name if name not in places), None)) is not None:
        raise MrpSumoError(f"{folder}: robot '{name}' has no start and goal{nearest(name, places)}")
    names = list(places)
    column = {name: r for r, name in enumerate(log.robot_name)}
    x, y = np.full((2, len(log.t_ns), len(names)), np.nan)
    for r, name in enumerate(names):
        if name in column:
            x[:, r], y[:, r] = log.x_m[:, column[name]], log.y_m[:, column[name]]
    start, goal = (np.array([places[name][end] for name in names], np.float64) for end in (0, 1))
    cell_m, tolerance_m, window, timeout_s = (constants[key] for key in DEFAULTS)
    metrics = execution_metrics(log.t_ns, x, y, start, goal, AnalyserConstants(cell_m, tolerance_m, int(window), timeout_s))
    metrics["timeBlockedPerAgent"] = {names[r]: value for r, value in metrics["timeBlockedPerAgent"].items()}
    metrics["agentsAtGoal"] = sorted(names[r] for r in metrics["agentsAtGoal"])
    return metrics


def _folder_of(bag: Path) -> Path:
    """The folder of a bag, of which the run's folder or a file may be said."""
    bag = bag if bag.name else bag.resolve()  # '.'
    folder = bag / "bag" if (bag / "bag" / "metadata.yaml").is_file() else bag
    return folder.parent if folder.is_file() and (folder.parent / "metadata.yaml").is_file() else folder


def _recorded(bag: Path, config: Path | None) -> tuple[dict[str, float], dict[str, Any]]:
    """Constants, and (start, goal) of robots, from the files that are there."""
    from mrp_sumo.errors import MrpSumoError
    from mrp_sumo.maps.yaml_text import parse, read_text

    beside = [bag.parent / (bag.name + suffix) for suffix in (".yaml", ".yml")]
    path = config or next((p for p in beside if p.is_file()), None)
    if path is None:
        return _constants_in(bag / "metadata.yaml"), {}
    document = parse(read_text(path))
    constants: dict[str, float] = {}
    places: dict[str, Any] = {}
    for key, value in _pairs(document):
        expected = "a number" if key in DEFAULTS else "a start [x, y] and a goal [x, y] in metres for each robot"
        try:
            if key in DEFAULTS and key not in constants:
                constants[key] = float(value)
            elif key == "robots" and isinstance(value, dict):  # {name: {start: [x, y], goal: [x, y]}}
                places |= {str(name): (_point(at["start"]), _point(at["goal"])) for name, at in value.items()}
            elif key == "startsAndGoals" and isinstance(value, list):  # MRP-Bench's
                places |= {str(at["assignedAgent"]): (_point(at["start_wcos"]), _point(at["goal_wcos"])) for at in value}
        except (TypeError, ValueError, KeyError, OverflowError):
            raise MrpSumoError(f"{path}: {key}: found {str(value)[:60]!r}, expected {expected}") from None
    if config is not None and not places:
        raise MrpSumoError(f"{path}: no starts and goals (keys 'robots' or MRP-Bench's 'startsAndGoals')")
    return constants, places


def _pairs(document: Any) -> Iterator[tuple[str, Any]]:
    """Every key of a document with its value, from the top down: MRP-Bench nests them by version."""
    if isinstance(document, dict):
        for key, value in document.items():
            yield str(key), value
        for value in document.values():
            yield from _pairs(value)
    elif isinstance(document, list):
        for value in document:
            yield from _pairs(value)


def _point(value: Any) -> tuple[float, float]:
    x, y = (float(number) for number in value)
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ValueError
    return x, y


def _constants_in(metadata: Path) -> dict[str, float]:
    from mrp_sumo.errors import MrpSumoError
    from mrp_sumo.maps.yaml_text import parse, read_text

    try:
        custom = parse(read_text(metadata))["rosbag2_bagfile_information"]["custom_data"]
        return {key: float(custom[key]) for key in DEFAULTS if key in custom}
    except (MrpSumoError, ValueError, KeyError, TypeError):  # other people's bags
        return {}
