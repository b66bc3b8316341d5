"""Error bands: how much a figure moves when quantities that are known to an interval move within it.

Quantities move together, by the design of Plackett and Burman (Biometrika 33, 1946) and its mirror image, so that a few runs tell the
effect of each, clear of what two of them do together. Two more settings, all at their worse and all at their better ends, bound the
figure. Refuses intervals of what is no number of the scenario, and such as do not hold its value.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.robot_type import Factors
from mrp_sumo.errors import MrpSumoError, nearest
from mrp_sumo.experiments.statistics import NOTHING, Interval, t_quantile
from mrp_sumo.io.documents import Place
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.keys import unknown_key
from mrp_sumo.io.scenario.names import robot_types
from mrp_sumo.io.scenario.read import changed

USUAL = 0.1  # share by which quantities move up and down whose interval nobody has given
MOST_QUANTITIES = 15  # that a design has room for
NUM_STATIONS = 3  # whose service times are quantities of their own; those of the others move together
OF_TYPE: Place = ("robots", "type")
OF_FLEET: Place = ("robots", "factor")
AT_STATIONS: Place = ("tasks", "service_factor")
DISTURBING: Place = ("execution", "disturbances")
USUALLY = {OF_FLEET: 1.0, AT_STATIONS: -1.0, DISTURBING: -1.0}  # what more of it gains
WORDS: dict[Place, str] = {
    (*OF_FLEET, "max_speed_mps"): "the top speed",
    (*OF_FLEET, "accel_mps2"): "acceleration",
    (*OF_FLEET, "decel_mps2"): "braking",
    (*OF_FLEET, "turn_rate_rad_s"): "turning",
    (*DISTURBING, "stops_per_s"): "how often robots stop",
    (*DISTURBING, "stop_median_s"): "how long robots stop",
    (*DISTURBING, "speed_noise"): "the scatter of the speed",
    (*DISTURBING, "speed_spread"): "how much slower some robots are",
}
FIRST_ROW = (1, 1, 0, 1, 1, 1, 0, 0, 0, 1, 0)  # of the design for up to eleven quantities

Bounds = Mapping[str, tuple[float, float]]  # by key of the scenario
Moves = Mapping[Place, float]  # values by key


@dataclass(frozen=True)
class Quantity:
    """Something that is known to an interval; several keys of one name move together."""

    name: str  # for people
    ends: tuple[tuple[Place, float, float], ...]  # keys of the scenario, with both ends
    is_given: bool  # False: its interval is the usual one

    def at(self, level: float) -> dict[Place, float]:
        """Values at the low end (-1) or the high one (1)."""
        return {place: high if level > 0 else low for place, low, high in self.ends}


@dataclass(frozen=True)
class Effect:
    """Change of a figure by a quantity on the way from its low end to its high one, all others at either end."""

    quantity: Quantity
    change: Interval

    @property
    def is_sure(self) -> bool:
        """True if it is more than chance."""
        return self.change.low > 0 or self.change.high < 0

    @property
    def document(self) -> dict[str, Any]:
        change, ends = self.change, self.quantity.ends
        keys = {".".join(map(str, place)): [rounded(low), rounded(high)] for place, low, high in ends}
        limits = {name: rounded(getattr(change, name)) for name in ("low", "high")}
        return {"name": self.quantity.name, "intervals": keys, "given": self.quantity.is_given, "effect": rounded(change.value), **limits}


def quantities(file: ScenarioFile, bounds: Bounds, stations: Sequence[str]) -> tuple[Quantity, ...]:
    """Quantities of a scenario with intervals: those that the user gives, that its types and disturbances carry, else the usual.

    Stations are those where robots are served, the busiest first. Raises MrpSumoError: one line, for an interval of what is no number, and
    one that does not hold the scenario's value.
    """
    known = dict(_carried(file)) | dict(_given(file, bounds))
    usual: dict[Place, float] = {(*OF_FLEET, name): value for name, value in vars(file.scenario.robots.factor).items()}
    if all(model.turn_rate_rad_s is None for model in robot_types(file)):
        del usual[*OF_FLEET, "turn_rate_rad_s"]
    disturbances = file.scenario.execution.disturbances
    usual |= {place: value for place in WORDS if place[:2] == DISTURBING and (value := getattr(disturbances, str(place[2]))) > 0}
    if not disturbances.stops_per_s:
        del usual[*DISTURBING, "stop_median_s"]
    at_stations = file.scenario.tasks.service_factor if file.scenario.tasks else {}
    usual |= {(*AT_STATIONS, name): at_stations.get(name, 1.0) for name in stations}
    ends = {place: (value * (1 - USUAL), value * (1 + USUAL)) for place, value in usual.items()} | known
    alone = [Quantity(_name(place), ((place, *ends[place]),), True) for place in known if ends[place][0] < ends[place][1]]
    rest = [place for place in usual if place not in known]
    speeding = [place for place in rest if place in ((*OF_FLEET, "accel_mps2"), (*OF_FLEET, "decel_mps2"))]
    served = [place for place in rest if place[:2] == AT_STATIONS]
    groups = [("acceleration and braking", speeding), ("the times at the other stations", served[NUM_STATIONS:])]
    together = {place for _, places in groups if len(places) > 1 for place in places}
    alone += [Quantity(_name(place), ((place, *ends[place]),), False) for place in rest if place not in together]
    alone += [Quantity(name, tuple((place, *ends[place]) for place in places), False) for name, places in groups if len(places) > 1]
    return tuple(alone)


def design(count: int) -> FloatArray:
    """[M, count] settings of so many quantities, -1 or 1: a design of Plackett and Burman above its mirror image.

    Raises MrpSumoError for more than MOST_QUANTITIES.
    """
    from scipy.linalg import hadamard

    size = next((size for size in (4, 8, 12, 16) if size > count), None)
    if size is None:
        raise MrpSumoError(
            f"--interval: {count} quantities would move, expected at most {MOST_QUANTITIES}: give a width of 0% to those that matter least"
        )
    if size == 12:
        rows = np.array([np.roll(FIRST_ROW, k) for k in range(11)] + [np.zeros(11)])
        half = 2.0 * rows - 1
    else:
        half = -np.array(hadamard(size), np.float64)[:, 1:]
    settings: FloatArray = np.concatenate([half, -half])[:, :count]
    return settings


def effects(of: Sequence[Quantity], settings: FloatArray, block: FloatArray, figures: FloatArray) -> tuple[Effect, ...]:
    """Effects of quantities, the largest first, by least squares with Student's limits of 95 %.

    Of M runs: their settings [M, K] of `design`; the number of the seed of each [M], since runs of one seed have the same orders; and their
    figures [M], NaN: none.
    """
    there = np.isfinite(figures)
    blocks = [(block == b).astype(np.float64) for b in np.unique(block[there])]
    matrix = np.column_stack([*blocks, settings])[there]
    freedom = int(there.sum()) - int(np.linalg.matrix_rank(matrix)) if there.any() else 0
    if freedom < 1:
        return tuple(Effect(quantity, NOTHING) for quantity in of)
    inverse = np.linalg.pinv(matrix.T @ matrix)
    slopes = inverse @ matrix.T @ figures[there]
    left = figures[there] - matrix @ slopes
    error = np.sqrt(np.maximum(np.diag(inverse), 0) * float(left @ left) / freedom)
    half = 2 * t_quantile(0.975, freedom) * error[len(blocks) :]
    changes = 2 * slopes[len(blocks) :]
    count = int(there.sum())
    by_quantity = [Effect(q, Interval(float(c), float(c - h), float(c + h), count)) for q, c, h in zip(of, changes, half)]
    return tuple(sorted(by_quantity, key=lambda effect: -abs(effect.change.value)))


def corner(of: Sequence[Effect], better: bool, more_is_better: bool = True) -> dict[Place, float]:
    """Values of all quantities at those ends at which a figure is better, or worse.

    Where chance alone may have made an effect, faster robots, shorter services and fewer disturbances are better.
    """

    def gain(effect: Effect) -> float:
        """By the high end of its interval."""
        if not effect.is_sure and (usual := USUALLY.get(effect.quantity.ends[0][0][:2])):
            return usual
        return effect.change.value if more_is_better else -effect.change.value

    levels = [math.copysign(1.0, gain(effect) if better else -gain(effect)) for effect in of]
    return values_at([effect.quantity for effect in of], levels)


def values_at(of: Sequence[Quantity], levels: Sequence[float]) -> dict[Place, float]:
    """Values of quantities at some of their ends."""
    return {place: value for quantity, level in zip(of, levels) for place, value in quantity.at(level).items()}


def as_changes(moves: Moves) -> dict[Place, tuple[str, Any]]:
    """Values of a scenario, as `io.scenario.read.changed` takes them. Intervals that it carries follow, or they would not hold them."""
    changes: dict[Place, tuple[str, Any]] = {place: ("--error-bands", value) for place, value in moves.items()}
    followed = {(*DISTURBING, "intervals", place[2]): [value, value] for place, value in moves.items() if place[:2] == DISTURBING}
    return changes | {place: ("--error-bands", bounds) for place, bounds in followed.items()}


def most(of: Sequence[Effect]) -> str:
    """The end of a sentence: which quantity matters most."""
    sure = [effect for effect in of if effect.is_sure]
    if not sure:
        return "none of these quantities stands out from chance"
    first = sure[0]
    close = [effect for effect in sure[1:2] if abs(effect.change.value) > 0.8 * abs(first.change.value)]
    return f"what matters most is {' and '.join(effect.quantity.name for effect in (first, *close))}"


def between(low: float, high: float, form: str) -> str:
    """Both ends in words, or one number where they look the same."""
    return " to ".join(dict.fromkeys((format(low, form), format(high, form))))


def spans(of: Sequence[Quantity]) -> str:
    """Intervals that are meant, for people."""
    usual = sum(not quantity.is_given for quantity in of)
    share = f"{100 * USUAL:.0f} % up and down"
    if not usual:
        return "these intervals"
    return f"{share} of what is assumed" if usual == len(of) else f"these intervals ({share} where none is known)"


def _name(place: Place) -> str:
    if place[:2] == AT_STATIONS:
        return f"the time at {place[2]}"
    return WORDS.get(place, ".".join(map(str, place)))


def _carried(file: ScenarioFile) -> Iterator[tuple[Place, tuple[float, float]]]:
    """Intervals that types and disturbances carry; the widest where types have their own."""
    factors = vars(file.scenario.robots.factor)
    plain = changed(file, {OF_FLEET: ("--error-bands", dict.fromkeys(factors, 1.0))})  # with factors, types have no intervals
    intervals = [(model, name, bounds) for model in robot_types(plain) for name, bounds in model.intervals.items() if name in factors]
    carrying = [(name, getattr(model, name), bounds) for model, name, bounds in intervals]
    for name in factors:
        shares = [(low / value, high / value) for each, value, (low, high) in carrying if each == name]
        if shares:
            yield (*OF_FLEET, name), (factors[name] * min(low for low, _ in shares), factors[name] * max(high for _, high in shares))
    for name, bounds in file.scenario.execution.disturbances.intervals.items():
        yield (*DISTURBING, name), bounds


def _given(file: ScenarioFile, bounds: Bounds) -> Iterator[tuple[Place, tuple[float, float]]]:
    for key, (low, high) in bounds.items():
        place: Place = tuple(key.split("."))
        value = value_of(file, key)
        if not (math.isfinite(low) and math.isfinite(high) and low <= value <= high):
            raise MrpSumoError(f"--interval {key}: found {low:g}:{high:g}, expected the scenario's value within it, {value:g}")
        if place[:2] == OF_TYPE:
            factor = getattr(file.scenario.robots.factor, str(place[2]))
            place, low, high = (*OF_FLEET, place[2]), factor * low / value, factor * high / value
        yield place, (low, high)


def value_of(file: ScenarioFile, key: str) -> float:
    """A scenario's value of a key. Raises MrpSumoError where it is no number."""
    if fault := unknown_key(key):
        raise MrpSumoError(f"--interval {key}: {fault}")
    place: Place = tuple(key.split("."))
    if place[:2] == OF_TYPE:
        known = [f"robots.type.{name}" for name in Factors.__dataclass_fields__]
        if key not in known:
            raise MrpSumoError(f"--interval {key}: expected one of {', '.join(known)}{nearest(key, known)}")
        values = {getattr(model, str(place[2])) for model in robot_types(file)}
        if len(values) > 1:
            raise MrpSumoError(f"--interval {key}: types of the fleet differ in it, expected robots.factor.{place[2]}, a factor on all")
        value = values.pop()
    elif place[:2] == AT_STATIONS and len(place) == 3:
        value = file.scenario.tasks.service_factor.get(str(place[2]), 1.0) if file.scenario.tasks else None
    else:
        value = file.scenario.model_dump()
        for part in place:
            value = value.get(part) if isinstance(value, dict) else None
    if not isinstance(value, float | int) or isinstance(value, bool):
        expected = "expected a key with one, such as robots.type.max_speed_mps"
        raise MrpSumoError(f"--interval {key}: the scenario has no number there, {expected}")
    return float(value)


def rounded(value: float, digits: int = 4) -> float | None:
    """So many digits, as JSON."""
    return float(f"{value:.{digits}g}") if math.isfinite(value) else None
