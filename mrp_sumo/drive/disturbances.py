"""What goes wrong in real fleets: noise, stops, delays, breakdowns, closed lanes, people in the way, late messages.

What there may be; `drive.world` makes it happen. Disturbances only ever slow robots down or hold them back: what
a policy promises, it promises under all of them. Refuses parameters out of range.
"""

from dataclasses import dataclass, fields

import numpy as np

from mrp_sumo.core.task import Task
from mrp_sumo.errors import ExecutionError


@dataclass(frozen=True)
class Breakdown:
    """A robot that stands still from `begin_s` on, for good by default."""

    robot: int
    begin_s: float
    duration_s: float = np.inf


@dataclass(frozen=True)
class Obstacle:
    """Something that stands on the floor for a while: a pallet, a human. Lanes within its radius plus that of a robot
    are closed. It comes when no robot is on them or may enter them: robots are seen by those who walk.
    """

    x_m: float
    y_m: float
    begin_s: float
    duration_s: float = np.inf
    radius_m: float = 0.3


@dataclass(frozen=True)
class Closure:
    """A lane, both directions, that nobody may set out on for a while."""

    tail: int
    head: int
    begin_s: float
    duration_s: float = np.inf


@dataclass(frozen=True)
class Outage:
    """A lift that nobody may enter for a while, and who is in it rides to the end; or a door that is locked."""

    lift: str = ""
    begin_s: float = 0.0
    duration_s: float = np.inf
    door: str = ""


@dataclass(frozen=True)
class Fire:
    """All lifts end their rides, go to the levels where they stood at first, and stay there for a while with open doors, for nobody."""

    begin_s: float
    duration_s: float = np.inf


Intervention = Breakdown | Closure | Task  # by somebody who watches


@dataclass(frozen=True)
class Disturbances:
    """How much of what. Zeros and empty lists: nothing is disturbed."""

    speed_spread: float = 0.0  # standard deviation of the robots' factors on their speed, N(1, sd) in [0.7, 1]
    speed_noise: float = 0.0  # standard deviation of an Ornstein-Uhlenbeck process u; the factor is 1 - |u|, at least 0.2
    speed_noise_tau_s: float = 2.0
    stops_per_s: float = 0.0  # random stops of a robot, Poisson
    stop_median_s: float = 3.0  # of their lognormal duration
    stop_sigma: float = 0.6
    start_delay_s: float = 0.0  # robots set out uniformly up to this late
    delay_probability: float = 0.0  # in each planned step, of being held for some steps, as in the League of Robot Runners
    delay_steps_min: int = 1
    delay_steps_max: int = 5
    latency_s: float = 0.0  # before a robot hears what it may enter
    message_loss: float = 0.0  # share of messages that do not come through; they are repeated every step
    localisation_m: float = 0.0  # standard deviation of where robots take themselves to be, in x and in y; only recorded
    localisation_rad: float = 0.0  # and of their heading
    localisation_tau_s: float = 0.0  # in which such errors are forgotten; 0: each sample has its own
    lift_rides_per_h: float = 0.0  # of people in each lift, Poisson
    lift_hold_s: float = 10.0  # mean of the exponential time for which they keep its doors open, as they board and as they leave
    door_passages_per_h: float = 0.0  # of people through each door, Poisson
    door_hold_s: float = 5.0  # mean of the exponential time for which they keep it open
    breakdowns: tuple[Breakdown, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    closures: tuple[Closure, ...] = ()
    outages: tuple[Outage, ...] = ()
    fires: tuple[Fire, ...] = ()

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if isinstance(value, tuple):
                continue
            if not (np.isfinite(value) and value >= 0):
                raise ExecutionError(f"disturbances: {each.name} is {value}, expected a number from 0 up")
        for name in ("delay_probability", "message_loss"):
            if getattr(self, name) >= 1:
                raise ExecutionError(f"disturbances: {name} is {getattr(self, name)}, expected less than 1")
        if not 1 <= self.delay_steps_min <= self.delay_steps_max:
            raise ExecutionError("disturbances: expected 1 <= delay_steps_min <= delay_steps_max")

    @property
    def any(self) -> bool:
        """Whether anything disturbs the robots themselves."""
        strengths = (self.speed_spread, self.speed_noise, self.stops_per_s, self.start_delay_s, self.delay_probability)
        listed = (self.breakdowns, self.obstacles, self.closures, self.outages, self.fires)
        visitors = (self.lift_rides_per_h, self.door_passages_per_h)
        return any(strengths) or any(listed) or any(visitors) or bool(self.latency_s or self.message_loss)


NONE = Disturbances()
