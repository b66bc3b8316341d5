"""Files of a calibration: that of a robot type, a set of disturbances, and all figures as a document.

Figures that the log does not tell are those of another type, and of no disturbance. Both files are read back before they are written.
"""

import math
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import yaml

from mrp_sumo.calibration.estimates import CONFIDENCE, LIMITS, CalibratedFigure, Calibration, counted
from mrp_sumo.calibration.stops import USUAL_S, USUAL_SIGMA
from mrp_sumo.core.arrivals import ServiceTime
from mrp_sumo.core.disturbances import Disturbances
from mrp_sumo.core.options import Options
from mrp_sumo.core.robot_type import Actions, Loaded, RobotShape
from mrp_sumo.errors import MrpSumoError, duration
from mrp_sumo.files.writing import write_text
from mrp_sumo.io.documents import read_document, validated
from mrp_sumo.io.scenario.robots import non_default

DISTURBING = ("speed_noise", "speed_noise_tau_s", "speed_spread", "stops_per_s", "stop_median_s", "stop_sigma")
DIGITS = 4
USUAL_MEMORY_S = 4.0, 1.0, 16.0  # of a scatter whose memory the log does not tell: recorded ones are 1.5 to 32 s
WIDER = 1.566  # 99 % intervals of a normal deviate beside 90 % ones


def type_of(result: Calibration, base: RobotShape) -> RobotShape:
    """The robot type: what the log tells, and the rest as `base` has it."""
    figures: dict[str, Any] = {name: _digits(result.quantities[name].value) for name in LIMITS if name in result.quantities}
    intervals = {name: _interval(result.quantities[name]) for name in figures}
    if "max_speed_mps" not in figures and result.fits is not None:
        figures["max_speed_mps"] = max(base.max_speed_mps, _digits(result.fits.speed_mps))  # slower ones would not do what is seen
    figures |= {key: max(size, 0.0) for key, size in result.log.body.items()}
    times = {}
    for kind in sorted(each.name for each in fields(Actions)):
        if (median := result.quantities.get(f"actions.{kind}.median_s")) is not None:
            sigma = result.quantities[f"actions.{kind}.sigma"].value
            times[kind] = ServiceTime(lognormal=(_digits(median.value), _digits(sigma)))
            intervals[f"actions.{kind}"] = _interval(median)
    if times:
        figures["actions"] = Actions(**times)
    if base.loaded is not None:
        figures["loaded"] = _no_faster(base.loaded, figures)
    span = duration(result.span_s)
    source = f"calibrated from {result.log.kind} {result.log.source}: {counted(len(result.vehicles), 'vehicles')}, {span} in all"
    return replace(base, **figures, source=source, intervals=intervals)


def _no_faster(loaded: Loaded, figures: dict[str, Any]) -> Loaded:
    top = figures.get("max_speed_mps", math.inf)
    return replace(loaded, speed_mps=None if loaded.speed_mps is None else min(loaded.speed_mps, top), length_m=None, width_m=None)


def disturbances_of(result: Calibration) -> Disturbances:
    """The disturbances that the log tells of."""
    known = {name: result.quantities[name] for name in DISTURBING if name in result.quantities}
    if "stops_per_s" in known and not known["stops_per_s"].value:
        del known["stops_per_s"]
    if (memory := known.get("speed_noise_tau_s")) is not None and memory.low < USUAL_MEMORY_S[1] and memory.high > USUAL_MEMORY_S[2]:
        value, low, high = USUAL_MEMORY_S
        known["speed_noise_tau_s"] = replace(memory, value=value, low=low, high=high)
    figures: dict[str, Any] = {name: _digits(each.value) for name, each in known.items()}
    if "stops_per_s" in known and "stop_median_s" not in known:
        figures |= {"stop_median_s": USUAL_S, "stop_sigma": USUAL_SIGMA}  # of which the rate was told
    return Disturbances(**figures, intervals={name: _interval(each) for name, each in known.items()})


def drift(result: Calibration, path: Path) -> dict[str, str]:
    """Figures that no longer fit a type that an earlier calibration wrote, and its disturbances: name -> both, in words.

    Two intervals of 90 % are widened to 99 % each, so that one figure in a hundred that has not changed seems to have.

    Raises MrpSumoError for a file that is no type, or without intervals.
    """
    document = read_document(path)
    if set(document.content) <= {each.name for each in fields(Disturbances)}:
        raise MrpSumoError(f"{path}: found a set of disturbances, expected the robot type beside it")
    earlier: list[Options] = [validated(document, RobotShape)]
    beside = path.with_name(f"{path.stem}.disturbances.yaml")
    if beside.is_file():
        earlier.append(validated(read_document(beside), Disturbances))
    if not any(getattr(each, "intervals", {}) for each in earlier):
        raise MrpSumoError(f"{path}: has no intervals, expected a file that `mrp-sumo calibrate --out` wrote")
    before = {}
    for options in earlier:
        actions: Actions | None = getattr(options, "actions", None)
        usual = vars(options) | ({} if actions is None else actions.usual_s)
        for name, ends in getattr(options, "intervals", {}).items():
            before[f"{name}.median_s" if name.startswith("actions.") else name] = (float(usual[name]), *ends)
    return differing(result, before)


def differing(result: Calibration, before: Mapping[str, tuple[float, float, float]]) -> dict[str, str]:
    """Figures that no longer fit earlier values, each with the ends of its interval: name -> both, in words."""
    changed = {}
    for name, (value, low, high) in before.items():
        if (now := result.quantities.get(name)) is None:
            continue
        reach = math.hypot(high - value, now.value - now.low) if now.value > value else math.hypot(value - low, now.high - now.value)
        if abs(now.value - value) > WIDER * reach:
            changed[name] = f"{value:.4g} ({low:.4g} to {high:.4g}) before, {now.value:.4g} ({now.low:.4g} to {now.high:.4g}) now"
    return changed


def _interval(of: CalibratedFigure) -> tuple[float, float]:
    return min(_digits(of.low), _digits(of.value)), max(_digits(of.high), _digits(of.value))


def _digits(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def document_of(result: Calibration) -> dict[str, Any]:
    """Everything that was found, for JSON."""
    return {
        "log": result.log.source,
        "kind": result.log.kind,
        "vehicles": result.vehicles,
        "span_s": round(result.span_s, 3),
        "confidence": CONFIDENCE,
        "quantities": {name: each.document for name, each in result.quantities.items()},
        "unknown": result.unknown,
        "notes": result.log.notes,
    }


def of_calibration(path: Path) -> tuple[Path, ...]:
    """Type, disturbances and picture that a calibration writes."""
    return path, path.with_suffix(".disturbances.yaml"), path.with_suffix(".png")


def require_free(path: Path) -> None:
    """Raises MrpSumoError where a file of a calibration is there already, or its folder is not."""
    if not path.parent.is_dir():
        raise MrpSumoError(f"{path.parent}: no such folder")
    for each in of_calibration(path):
        if each.exists():
            raise MrpSumoError(f"{each}: is there already, expected a name of a new file")


def write_files(result: Calibration, base: RobotShape, path: Path) -> tuple[Path, Path]:
    """Write `TYPE.yaml` and beside it `TYPE.disturbances.yaml`."""
    _, beside, _ = of_calibration(path)
    write_options(type_of(result, base), path)
    write_options(disturbances_of(result), beside)
    return path, beside


def write_options(options: Options, path: Path) -> None:
    """Write what differs from the defaults as YAML. Raises MrpSumoError where it cannot be written."""
    write_text(path, yaml.safe_dump(non_default(options), sort_keys=False, default_flow_style=None, width=140, allow_unicode=True))
