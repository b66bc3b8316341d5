"""Charging: at which levels and where, and the states of charge of a run.

The levels at which robots charge are those of a VDA 5050 factsheet (`batteryCharging`).
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal

from annotated_types import Interval

from mrp_sumo.core.options import Options, meaning, option
from mrp_sumo.core.shifts import Shift, Span, spans_of
from mrp_sumo.errors import OptionError

if TYPE_CHECKING:
    from mrp_sumo.core.graph import FloatArray

PERCENT: dict[str, float] = {"ge": 0, "le": 100}
Percent = Annotated[float, Interval(**PERCENT)]


@dataclass(frozen=True, kw_only=True)
class Charging(Options):
    """Charging of robots; levels in percent, with the names of a VDA 5050 factsheet."""

    stations: tuple[str, ...] = field(metadata=meaning("Names of groups, stations or vertices: a place each.", min_length=1))
    policy: Literal["threshold", "opportunity"] = option(
        "threshold", "'threshold': robots charge when they have to; 'opportunity': when they have nothing else to do, too."
    )
    critical_low_charging_level: float = option(20.0, "Level at or below which a robot without a load goes to charge.", **PERCENT)
    minimum_desired_charging_level: float = option(50.0, "Level from which 'opportunity' calls robots off when tasks wait.", **PERCENT)
    maximum_desired_charging_level: float = option(100.0, "Level at which charging ends.", **PERCENT)
    minimum_charging_time_s: float = option(0.0, "Least time that a robot stays.", ge=0)
    swap_s: float | None = option(None, "Time in which a battery is swapped for a full one instead, whatever its level.", gt=0, le=1e6)
    shifts: tuple[Shift, ...] = option(
        (), "Shifts of the people there: charging begins only within, and ends also after; always by default."
    )
    start_level: tuple[Percent, Percent] = option((100.0, 100.0), "Range of levels at the start, drawn uniformly.")
    start_charging: float = option(0.0, "Share of the robots that go to charge first, whatever their level.", **PERCENT)

    def __post_init__(self) -> None:
        super().__post_init__()
        levels = [self.critical_low_charging_level, self.minimum_desired_charging_level, self.maximum_desired_charging_level]
        if not levels[0] < levels[2] or not levels[0] <= levels[1] <= levels[2]:
            raise OptionError(f"levels are {levels}, expected critical_low, minimum_desired and maximum_desired in ascending order")
        if self.opportunity and levels[0] == levels[1]:  # who is called off would have to charge again at once
            raise OptionError(f"levels are {levels}, expected with policy opportunity a minimum_desired above critical_low")
        if self.swap_s is not None and levels[2] < 100:
            raise OptionError(
                f"maximum_desired_charging_level is {levels[2]:g} with swap_s, expected 100: a battery is swapped for a full one"
            )
        if self.start_level[0] > self.start_level[1]:
            raise OptionError(f"start_level is {list(self.start_level)}, expected the least and the most")

    @property
    def spans_s(self) -> tuple[Span, ...]:
        """Times of each day in which charging begins; none: always."""
        return spans_of(self.shifts)

    @property
    def opportunity(self) -> bool:
        return self.policy == "opportunity"

    @property
    def critical(self) -> float:
        """Share of the capacity, as the next two."""
        return self.critical_low_charging_level / 100

    @property
    def minimum(self) -> float:
        return self.minimum_desired_charging_level / 100

    @property
    def maximum(self) -> float:
        return self.maximum_desired_charging_level / 100


def full_s(charging: Charging | None, of_battery_s: float) -> float:
    """Time that takes a battery from empty to full, which takes so long at a charger."""
    return of_battery_s if charging is None or charging.swap_s is None else charging.swap_s


def start_shares(charging: Charging | None) -> tuple[float, float]:
    """Shares of the capacity between which robots begin."""
    least, most = charging.start_level if charging else (100.0, 100.0)
    return least / 100, most / 100


@dataclass(frozen=True, eq=False)
class BatteryLog:
    """States of charge of R robots at K times of a run."""

    t_s: "FloatArray"  # [K]
    level: "FloatArray"  # [K, R] shares of the capacity
    used_j: "FloatArray"  # [R] drawn in the whole run
    charged_j: "FloatArray"  # [R]
    critical: float  # the level at which robots go to charge; 0 where they do not
