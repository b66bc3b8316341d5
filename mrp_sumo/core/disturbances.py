"""Disturbances of real fleets: noise, stops, delays, breakdowns, closed lanes, people in the way, late messages.

`execution.disturbances` of a scenario; `drive.world` makes it happen. Disturbances only ever slow robots down or hold them back: what
a policy promises, it promises under all of them.
"""

from dataclasses import dataclass, field, fields
from math import inf

from mrp_sumo.core.options import INTERVALS, Figure, Options, meaning, option, require_intervals
from mrp_sumo.errors import OptionError

DURATION: dict[str, float] = {"gt": 0, "le": 1e9}
BEGIN, FOR_GOOD = "When it begins, in simulated time.", "How long it lasts; for good by default."
ONLY_RECORDED = "localisation"  # options that begin so change what robots believe, not what they do
NAMED_DISTURBANCES: dict[str, dict[str, float]] = {  # where they are from: docs/calibrate.md
    "nav2_like": {"speed_noise": 0.053, "speed_noise_tau_s": 2.0},
    "create_like": {"speed_noise": 0.058, "speed_noise_tau_s": 5.7},
}


@dataclass(frozen=True)
class Breakdown(Options):
    """A robot that stands still for a while."""

    robot: int = field(metadata=meaning("Its number, from 0.", ge=0))
    begin_s: float = field(metadata=meaning(BEGIN))
    duration_s: float | None = option(None, FOR_GOOD, **DURATION)


BREAKS, MAINTAINED = "breaks down", "is maintained"


@dataclass(frozen=True)
class Failure:
    """A breakdown that comes with use. It stands in the way for a while at most, and may be moved from then on."""

    robot: int
    begin_s: float
    duration_s: float
    stands_s: float = inf
    speed_mps: float = inf  # at most, of one that is moved
    text: str = BREAKS


@dataclass(frozen=True)
class Obstacle(Options):
    """Something that stands on the floor for a while: a pallet, a human. Lanes within its radius plus that of a robot
    are closed. It comes when no robot is on them or may enter them: robots are seen by those who walk.
    """

    x_m: float = field(metadata=meaning("Of its centre."))
    y_m: float = field(metadata=meaning("Of its centre."))
    begin_s: float = field(metadata=meaning(BEGIN))
    duration_s: float | None = option(None, FOR_GOOD, **DURATION)
    radius_m: float = option(0.3, "Radius of what it covers.", gt=0, le=1e9)


@dataclass(frozen=True)
class Closure(Options):
    """A stretch that nobody may set out on for a while."""

    between: tuple[str, str] = field(
        metadata=meaning("Names of two vertices: the shortest path between them is closed in both directions.")
    )
    begin_s: float = option(0.0, BEGIN, ge=0)
    duration_s: float | None = option(None, FOR_GOOD, **DURATION)


@dataclass(frozen=True)
class ClosedLane:
    """A lane of a closed stretch, both directions."""

    tail: int
    head: int
    begin_s: float
    duration_s: float | None = None


@dataclass(frozen=True)
class Outage(Options):
    """A lift that nobody may enter for a while, and who is in it rides to the end; or a door that is locked."""

    lift: str = option("", "Its name.")
    door: str = option("", "Its name, where doors are automatic.")
    begin_s: float = option(0.0, BEGIN, ge=0)
    duration_s: float | None = option(
        None, "For good by default; planners know of what is out of service from the start for good.", **DURATION
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.lift) == bool(self.door):
            raise OptionError("give lift or door")

    @property
    def is_from_the_start(self) -> bool:
        """True if it is never in service, so that planners need not count on it."""
        return self.begin_s == 0 and self.duration_s is None


@dataclass(frozen=True)
class Fire(Options):
    """A fire alarm: lifts end their rides, go to the levels where they stood at first, and stay there with open doors, for nobody."""

    begin_s: float = field(metadata=meaning(BEGIN, ge=0))
    duration_s: float | None = option(None, FOR_GOOD, **DURATION)


@dataclass(frozen=True, kw_only=True)
class Disturbances(Options):
    """Disturbances, drawn with a seed. None by default; the name of a set alone is short for it."""

    name: str = option("", f"A named set, or a YAML file, whose values other keys change: {', '.join(NAMED_DISTURBANCES)}.")
    seed: int | None = option(None, "By default the scenario's.", ge=0, lt=2**63)
    speed_spread: float = option(0.0, "Standard deviation of the robots' factors on their speed, N(1, sd) in [0.7, 1].", ge=0)
    speed_noise: float = option(
        0.0,
        "Standard deviation of an Ornstein-Uhlenbeck process: its absolute value, at most 0.8, is the share of speed that a robot loses.",
        ge=0,
    )
    speed_noise_tau_s: float = option(2.0, "Time constant of that process.", ge=0)
    stops_per_s: float = option(0.0, "Random stops of a robot, Poisson.", ge=0)
    stop_median_s: float = option(3.0, "Median of their lognormal duration.", ge=0)
    stop_sigma: float = option(0.6, "Standard deviation of its logarithm.", ge=0)
    start_delay_s: float = option(0.0, "Robots set out up to this late, uniformly.", ge=0)
    delay_probability: float = option(
        0.0, "Probability, in each planned step, of being held for some steps, as in the League of Robot Runners.", ge=0, lt=1
    )
    delay_steps_min: int = option(1, "The least number of such steps.", ge=1)
    delay_steps_max: int = option(5, "The greatest number of such steps.", ge=1)
    latency_s: float = option(0.0, "Delay until a robot learns what it may enter.", ge=0)
    message_loss: float = option(0.0, "Share of messages that are lost; they are repeated every step.", ge=0, lt=1)
    localisation_m: float = option(
        0.0, "Standard deviation of believed positions, in x and y; in believed.parquet and the bag, nothing else.", ge=0
    )
    localisation_rad: float = option(0.0, "Standard deviation of believed headings.", ge=0)
    localisation_tau_s: float = option(0.0, "Time constant of these errors; 0: each sample has its own.", ge=0)
    lift_rides_per_h: float = option(0.0, "People's rides in each lift, between random levels, Poisson.", ge=0)
    lift_hold_s: float = option(
        10.0, "Mean of the exponential time for which they keep its doors open when they board, and again when they leave.", ge=0
    )
    door_passages_per_h: float = option(0.0, "People's passages through each automatic door, Poisson.", ge=0)
    door_hold_s: float = option(5.0, "Mean of the exponential time for which they keep it open.", ge=0)
    breakdowns: tuple[Breakdown, ...] = option((), "Robots that stand still for a while.")
    obstacles: tuple[Obstacle, ...] = option((), "What stands on the floor for a while.")
    closures: tuple[Closure, ...] = option((), "Stretches that nobody may set out on for a while.")
    outages: tuple[Outage, ...] = option((), "Lifts out of service and locked doors.")
    fires: tuple[Fire, ...] = option((), "Fire alarms.")
    intervals: dict[str, tuple[Figure, Figure]] = field(default_factory=dict, hash=False, metadata=meaning(INTERVALS))

    def __post_init__(self) -> None:
        super().__post_init__()
        require_intervals(self)
        if not self.delay_steps_min <= self.delay_steps_max:
            raise OptionError("expected 1 <= delay_steps_min <= delay_steps_max")

    @property
    def any(self) -> bool:
        """True where anything disturbs the robots themselves."""
        kinds = (each.name for each in fields(self) if each.default in (0.0, ()) and not each.name.startswith(ONLY_RECORDED))
        return any(getattr(self, kind) for kind in kinds)


NONE = Disturbances()


def end_s(what: Breakdown | Obstacle | ClosedLane | Outage | Fire) -> float:
    """Until when something lasts; inf for good."""
    return inf if what.duration_s is None else what.begin_s + what.duration_s
