"""Shifts of the people at stations: hours of each day, counted from the begin of a run, in which services may begin."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import floor, inf

from mrp_sumo.core.arrivals import DAY_S, HOUR_S
from mrp_sumo.core.options import Options, meaning, option
from mrp_sumo.errors import OptionError

Span = tuple[float, float]  # begin and end, in s from the begin of a day


@dataclass(frozen=True, kw_only=True)
class Shift(Options):
    """A shift with its breaks, the same each day; a day of 24 h begins with the run."""

    begin_h: float = field(metadata=meaning("Hour of the day.", ge=0, lt=24))
    end_h: float = field(metadata=meaning("Hour of the day; above 24 where it ends on the next.", gt=0, le=48))
    breaks_h: tuple[tuple[float, float], ...] = option((), "Begin and end of each break, in hours of the day.")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.begin_h < self.end_h <= self.begin_h + 24:
            raise OptionError(
                f"shift from {self.begin_h:g} to {self.end_h:g} h is empty or longer than a day, expected end_h above begin_h "
                "(6 to 14, or over midnight 22 to 30)"
            )
        last_h = self.begin_h
        for begin_h, end_h in self.breaks_h:
            if not last_h <= begin_h < end_h <= self.end_h:
                raise OptionError(
                    f"break from {begin_h:g} to {end_h:g} h, expected its end after it, within {self.begin_h:g} to {self.end_h:g} h, "
                    "and breaks in ascending order"
                )
            last_h = end_h
        if not self.spans_s:
            raise OptionError(f"shift from {self.begin_h:g} to {self.end_h:g} h is all breaks, expected time to work")

    @property
    def spans_s(self) -> tuple[Span, ...]:
        """Times in which services begin."""
        edges = [self.begin_h, *(edge for each in self.breaks_h for edge in each), self.end_h]
        return tuple((a * HOUR_S, b * HOUR_S) for a, b in zip(edges[::2], edges[1::2]) if b > a)


def spans_of(shifts: Iterable[Shift]) -> tuple[Span, ...]:
    """Times of each day in which services begin in some shifts; none: there are no shifts."""
    return tuple(span for shift in shifts for span in shift.spans_s)


def opens_s(spans_s: tuple[Span, ...], t_s: float) -> float:
    """Time from `t_s` on at which services may begin first; spans are those of each day, none: always."""
    if not spans_s:
        return t_s
    day = floor(t_s / DAY_S)
    begins = ((begin_s + d * DAY_S, end_s + d * DAY_S) for d in (day - 1, day, day + 1) for begin_s, end_s in spans_s)
    return min((max(begin_s, t_s) for begin_s, end_s in begins if t_s < end_s), default=inf)
