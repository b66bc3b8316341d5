"""Arrivals of tasks and durations of their stops: options of the streams of a scenario, and draws from them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from annotated_types import Interval

from mrp_sumo.core.options import Options, option
from mrp_sumo.errors import OptionError

if TYPE_CHECKING:
    from numpy.random import Generator

HOUR_S = 3600.0
DAY_S = 24 * HOUR_S
MAX_OPEN = 100_000
Positive = Annotated[float, Interval(gt=0)]
NotNegative = Annotated[float, Interval(ge=0)]


@dataclass(frozen=True, kw_only=True)
class ServiceTime(Options):
    """Duration of a stop; a number is short for constant_s."""

    constant_s: float | None = option(None, "Constant.", ge=0)
    triangular_s: tuple[NotNegative, NotNegative, NotNegative] | None = option(None, "Least, usual and most.")
    lognormal: tuple[Positive, NotNegative] | None = option(None, "Median in s, and sigma of the logarithm.")

    def __post_init__(self) -> None:
        super().__post_init__()
        keys = [key for key in ("constant_s", "triangular_s", "lognormal") if getattr(self, key) is not None]
        if len(keys) != 1:
            raise OptionError(f"give one of constant_s, triangular_s, lognormal; found {', '.join(keys) or 'none'}")
        if self.triangular_s and not self.triangular_s[0] <= self.triangular_s[1] <= self.triangular_s[2]:
            raise OptionError(f"triangular_s is {list(self.triangular_s)}, expected least, usual and most in ascending order")

    @property
    def mean_s(self) -> float:
        """Mean."""
        if self.lognormal:
            return self.lognormal[0] * math.exp(self.lognormal[1] ** 2 / 2)
        return sum(self.triangular_s) / 3 if self.triangular_s else self.constant_s or 0.0

    def draw(self, rng: "Generator") -> float:
        """A time in s, from one number of the generator."""
        if self.lognormal:
            return float(rng.lognormal(math.log(self.lognormal[0]), self.lognormal[1]))
        if self.triangular_s is None:
            return self.constant_s or 0.0
        least, usual, most = self.triangular_s
        span, u = most - least, float(rng.random())
        if span <= 0:
            return usual
        if u < (usual - least) / span:
            return least + math.sqrt(u * span * (usual - least))
        return most - math.sqrt((1 - u) * span * (most - usual))


@dataclass(frozen=True, kw_only=True)
class Arrivals(Options):
    """Arrivals of tasks; exactly one kind."""

    rate_per_h: float | None = option(None, "Poisson arrivals.", gt=0, le=1e6)
    profile: tuple[NotNegative, ...] = option((), "Of Poisson arrivals: factors on the rate in equal parts of a day.")
    open: int | None = option(None, "Number of orders that are always known and not done: a closed loop.", ge=1, le=MAX_OPEN)
    per_step: float | None = option(None, "Tasks in a planned step; below 1 one with that probability.", gt=0, le=1e3)
    at_once: bool = option(False, "All at 0; needs count.")

    def __post_init__(self) -> None:
        super().__post_init__()
        keys = [key for key in ("rate_per_h", "open", "per_step") if getattr(self, key) is not None] + ["at_once"] * self.at_once
        if len(keys) != 1:
            raise OptionError(f"give one of rate_per_h, open, per_step, at_once; found {', '.join(keys) or 'none'}")
        if self.profile and (self.rate_per_h is None or max(self.profile) <= 0):
            raise OptionError("profile goes with rate_per_h, and needs a factor above 0")
        if self.per_step is not None and self.per_step > 1 and self.per_step != round(self.per_step):
            raise OptionError(f"per_step is {self.per_step:g}, expected a whole number, or one below 1")

    def times(self, rng: "Generator", step_s: float = 1.0, clock_s: float = 0.0) -> Iterator[float]:
        """Ascending times, without end. Those of `open` are 0: such a task is released when one before it is done.

        `step_s` is the plan's, for `per_step`; `clock_s` is how much of the day is over at 0, for `rate_per_h`.
        """
        t_s = 0.0
        if self.rate_per_h is not None:
            profile = self.profile or (1.0,)
            most = self.rate_per_h * max(profile) / HOUR_S
            while True:  # thinning: Lewis and Shedler, "Simulation of nonhomogeneous Poisson processes by thinning", 1979
                t_s += float(rng.exponential(1 / most))
                part = int((t_s + clock_s) % DAY_S / DAY_S * len(profile))
                if float(rng.random()) * max(profile) < profile[part]:
                    yield t_s
        elif self.per_step is not None:
            whole = max(1, round(self.per_step))
            while True:
                if self.per_step >= 1 or float(rng.random()) < self.per_step:
                    yield from [t_s] * whole
                t_s += step_s
        else:
            while True:
                yield 0.0
