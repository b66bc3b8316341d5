"""Question of a capacity study, and the trials that it may request.

A trial is a run of the study: so many robots, one seed. Trials of one seed meet the same orders and start from the same draws whatever the
size of the fleet: common random numbers. Refuses questions that the scenario cannot answer.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Any

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.error_bands import as_changes
from mrp_sumo.io.documents import Place
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.robots import RobotGroup
from mrp_sumo.io.scenario.tasks import StreamChoice

Values = dict[Place, tuple[str, Any]]  # of a scenario, with the option that sets each

SATURATED, DEMAND, ONE_SHOT = "saturated", "demand", "one_shot"
AS_MANY_AS_FIT = -1, -1  # sizes that the map decides
ON_TIME, SUCCEED = 0.95, 0.8  # wanted shares of orders, and of one-shot draws, by default
GRID_SHARE, BEFORE_CHANGES = 0.6, 0.6  # of the budget
BACKLOG = 2.0  # orders a robot that are known in saturated runs: the one it has, and one that waits
CORES = 2  # of the machine that budgets are meant for
ROBOT_S_PER_CPU_S = 2500.0  # of a small fleet on the kinematic engine, planning included
CROWD = 300.0  # robots that make a robot-second twice as dear
SUMO_TIMES = 10.0  # what a run costs more on SUMO
IN_SUMO = "execution.engine: sumo"  # the change of trials that confirm the answer


@dataclass(frozen=True)
class Effort:
    """Precision of an answer, and its budget."""

    horizon_s: float  # simulated time of a run
    seeds: int  # of every size at first
    most_seeds: int
    precision: float  # wanted half-width of limits, as a share of the mean
    growth: float  # from one size of the coarse grid to the next
    gap: float  # sizes as near as this, as a ratio, are not parted further
    budget_s: float  # time on `CORES` cores


FULL = Effort(horizon_s=3600.0, seeds=5, most_seeds=30, precision=0.05, growth=1.5, gap=1.1, budget_s=1200.0)
QUICK = Effort(horizon_s=1200.0, seeds=3, most_seeds=6, precision=0.1, growth=2.0, gap=1.3, budget_s=180.0)


def effort_of(quick: bool, budget_s: float | None, horizon_s: float | None) -> Effort:
    """The effort of a quick or a full study, with a budget and a horizon of its own where these are not None."""
    effort = QUICK if quick else FULL
    return replace(effort, budget_s=budget_s or effort.budget_s, horizon_s=horizon_s or effort.horizon_s)


@dataclass(frozen=True)
class Cycle:
    """Driving and charging of one robot, over and over."""

    drive_s: float  # from full to where it goes to charge, or empty where it cannot
    charge_s: float  # 0 where it cannot
    places: int  # to charge at
    highest: float = 1.0  # level where orders always wait, as a share of the capacity

    @property
    def charging_share(self) -> float:
        """Of the time, with places for all."""
        return self.charge_s / (self.drive_s + self.charge_s)

    @property
    def most_robots(self) -> int:
        """That the places keep going: each is charged for its share of the time, and no place charges two."""
        return int(self.places / self.charging_share + 1e-9) if self.charge_s else 0


@dataclass(frozen=True)
class Question:
    """Question about a scenario. What is left open follows from that, see `study.completed`."""

    file: ScenarioFile
    sizes: tuple[int, int] = AS_MANY_AS_FIT  # least and most robots
    effort: Effort = FULL
    demand_per_h: float | None = None  # None: the scenario's own
    share: float = 0.0  # of orders that are to be on time; of one-shot scenarios, of draws that are to succeed; 0: the usual one
    engine: str = "kinematic"
    first_seed: int = 0
    what_if: tuple[str, ...] = ()  # as the user wrote them; 'auto' tries the obvious ones
    confirm: bool = False  # drive the sizes that the answer names in SUMO, too
    command: str = ""  # that asks it again
    charging: Cycle | None = None  # of robots with batteries
    bounds: tuple[tuple[str, tuple[float, float]], ...] | None = None  # intervals that the user gives; None: no error bands are wanted

    @property
    def on_time(self) -> float:
        """The share of orders that are to be on time, or of draws that are to succeed."""
        return self.share or (ON_TIME if self.has_tasks else SUCCEED)

    @property
    def most_robots(self) -> int:
        """The largest fleet that is asked about, or fewer where the places to charge keep no more going."""
        most = self.sizes[1]
        return min(most, self.charging.most_robots) if self.charging and self.charging.places else most

    @property
    def has_tasks(self) -> bool:
        """True if orders come while robots drive."""
        return self.file.scenario.tasks is not None


@dataclass(frozen=True, order=True)
class Trial:
    """A run of a study."""

    kind: str
    robots: int
    seed: int
    change: str = ""  # what is otherwise than in the scenario, as `what_if` reads it
    planner: str = ""  # instead of the scenario's
    moves: tuple[tuple[Place, float], ...] = ()  # values of the quantities that error bands move


def spendable(question: Question) -> tuple[float, float]:
    """Shares of the budget that the coarse grid may spend, and all that comes before changes are tried."""
    before_changes = BEFORE_CHANGES if question.what_if else 1.0
    return GRID_SHARE * before_changes, before_changes


def predicted_s(trials: Iterable[Trial], question: Question, slower: float = 1.0) -> float:
    """Roughly what trials take on `CORES` cores. A formula and no clock, so that a budget buys the same runs on every machine.

    Driving takes `slower` times as long as usual.
    """

    def cpu_s(trial: Trial) -> float:
        driving_s = 0.5 + slower * driving_cpu_s(trial.robots, question.effort.horizon_s)
        cost = 0.3 + trial.robots / 60 if trial.kind == ONE_SHOT else driving_s
        return cost * (SUMO_TIMES if question.engine == "sumo" or trial.change == IN_SUMO else 1.0)

    return sum(map(cpu_s, trials)) / CORES


def driving_cpu_s(robots: int, sim_time_s: float) -> float:
    """Roughly what planning and driving a fleet takes on the kinematic engine."""
    return sim_time_s * robots * (1 + robots / CROWD) / ROBOT_S_PER_CPU_S


def values_of(trial: Trial, question: Question, changed: Values) -> Values:
    """Values of a trial other than the scenario's, as for `io.scenario.changed`; `changed` is what its change says, the tasks included."""
    changed = {**changed, **as_changes(dict(trial.moves))}
    values: Values = {
        **_robots(question.file.scenario.robots.fleet, trial.robots),
        ("seed",): ("--seed", question.first_seed + trial.seed),
        ("execution", "engine"): ("--engine", question.engine),
        ("record", "bag"): ("capacity", False),
    }
    if trial.planner and not any(place[0] == "planner" for place in changed):
        values["planner", "name"] = ("capacity", trial.planner)
    tasks = question.file.scenario.tasks
    if tasks is None:
        return {**values, **changed}
    document = {**tasks.model_dump(), **changed.pop(("tasks",), ("", {}))[1]}
    if trial.kind == DEMAND:
        assert question.demand_per_h is not None
        document["streams"] = demanded(tasks.streams, document["streams"], question.demand_per_h)
    else:
        document["open"] = ceil(BACKLOG * trial.robots)
    if question.charging and question.charging.places:
        document["charging"] = _in_steady_state(document["charging"], question.charging, trial)
    return {
        ("robots", "starts"): ("capacity", None),  # drawn: the n-th robot's is the same in every fleet
        ("robots", "goals"): ("capacity", None),
        ("robots", "draw"): ("capacity", "anywhere"),
        **values,
        ("tasks",): ("capacity", document),
        ("execution", "time_limit_s"): ("capacity", question.effort.horizon_s),
        **changed,
    }


def _in_steady_state(charging: Mapping[str, Any], cycle: Cycle, trial: Trial) -> dict[str, Any]:
    """Charging as it is once it has gone on for long: robots at all points of their cycle, some of them at chargers.

    Where orders always wait, `opportunity` calls robots off at the minimum, so that no level is above it.
    """
    share = min(cycle.charging_share, cycle.places / trial.robots)
    highest = charging["maximum_desired_charging_level"] if trial.kind == DEMAND else round(100 * cycle.highest, 6)
    levels = [charging["critical_low_charging_level"], highest]
    return {**charging, "start_level": levels, "start_charging": round(100 * share, 1)}


def _robots(fleet: Sequence[RobotGroup] | None, count: int) -> Values:
    """So many robots; of a fleet of several types in the shares of its groups (largest remainders), one of each where there are enough."""
    if fleet is None:
        return {("robots", "count"): ("--robots", count)}
    size = [group.size for group in fleet]
    spare = max(count - len(fleet), 0)
    share = [spare * n / sum(size) for n in size]
    number = [int(part) + (k < count) for k, part in enumerate(share)]
    for k in sorted(range(len(fleet)), key=lambda k: int(share[k]) - share[k])[: count - sum(number)]:
        number[k] += 1
    groups = [{"type": group.model_dump()["type"], "count": n} for group, n in zip(fleet, number) if n]
    return {("robots", "fleet"): ("--robots", groups)}


def own_demand_per_h(streams: tuple[StreamChoice, ...]) -> float | None:
    """Orders an hour in the busiest part of the day; None where streams have no rates."""
    rates = _busiest(streams)
    return sum(rates) if rates else None


def demanded(streams: tuple[StreamChoice, ...], documents: Any, per_h: float) -> list[dict[str, Any]]:
    """Streams that bring so many orders an hour, in the mix of the busiest part of the day."""
    shares = _busiest(streams) or [float(s.arrivals.open or 1) for s in streams]
    return [
        {**document, "arrivals": {"rate_per_h": per_h * share / sum(shares)}} for document, share in zip(documents, shares) if share > 0
    ]


def _busiest(streams: tuple[StreamChoice, ...]) -> list[float]:
    """Rates an hour of streams in the busiest part of the day, [] where one has none."""
    if any(stream.arrivals.rate_per_h is None for stream in streams):
        return []
    moments = range(24 * 60)
    by_stream = [(stream.arrivals.rate_per_h or 0.0, stream.arrivals.profile or (1.0,)) for stream in streams]
    rates = ([per_h * profile[int(m / len(moments) * len(profile))] for per_h, profile in by_stream] for m in moments)
    return max(rates, key=sum, default=[])


def require_sizes(low: int, high: int) -> None:
    """Refuse fleets of nobody, and a range that ends before it begins. Raises MrpSumoError."""
    if not 1 <= low <= high:
        raise MrpSumoError(f"--robots {low}..{high}: expected at least one robot, and the smaller number first, such as 5..60")


def require_answerable(question: Question) -> None:
    """Refuse what the scenario cannot answer. Raises MrpSumoError: one line, with what would do."""
    name, tasks = question.file.scenario.name, question.file.scenario.tasks
    if question.sizes != AS_MANY_AS_FIT:
        require_sizes(*question.sizes)
    if question.confirm and question.engine == "sumo":
        raise MrpSumoError("--confirm sumo: with --engine sumo every run is driven in SUMO already; leave one of them out")
    if tasks is None:
        if question.bounds is not None:
            raise MrpSumoError(
                f"--error-bands: '{name}' has no orders, whose number depends on speeds and times; give it tasks, or leave it out"
            )
        if question.demand_per_h is not None:
            raise MrpSumoError(f"--demand: '{name}' has no orders to count; give it tasks (docs/scenario.md), or leave --demand out")
        return
    if tasks.list or tasks.file or not tasks.streams or any(stream.count for stream in tasks.streams):
        raise MrpSumoError(f"{question.file.at('tasks')}: these orders come to an end; a throughput needs streams without a count")
