"""The disturbed runs of the noise campaign, driven by SUMO and by the kinematic engine: they have to agree.

At every sample, robots are within a centimetre of where the other engine has them; they make the same visits, in the same order at every
vertex, within a step; the same things happen to the same robots at the same places, within a step; people walk the same ways. Both
pass the audit.
"""

import json
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from campaigns.driver import Trial
from campaigns.noise import BUILDINGS, SHARES, Drawn, Worlds, draw, plain

from mrp_sumo.core.execution import Execution
from mrp_sumo.core.people import PeopleLog
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive import replanning
from mrp_sumo.drive.loop import simulate
from mrp_sumo.engines.sumo.network import build_network
from mrp_sumo.errors import ExecutionError, PlanError
from mrp_sumo.metrics.audit import audit

ENGINES = ("sumo", "kinematic")
FAR_M = 0.01
WITHIN = {"1 um": 1e-6, "1 mm": 1e-3, "1 cm": FAR_M, "more": np.inf}
LIMITED = 0.15  # of the runs have limits of speed on some lanes
EFFORT = 1_000_000  # of a new plan


class Engines:
    """One plan a trial, driven twice."""

    size = None
    shares: Mapping[str, float] = SHARES

    def __init__(self, seed: int) -> None:
        self._scratch = tempfile.TemporaryDirectory(prefix="engines-")
        self._worlds, self._first = Worlds(None, Path(self._scratch.name), self.shares), seed * 10_000_000

    def trial(self, number: int, folder: Path) -> Trial:
        replanning.EFFORT = EFFORT
        drawn = draw(self._first + number, self._worlds)
        if isinstance(drawn, dict):
            return Trial(drawn["family"], drawn["ended"])
        row, problem, network = drawn.row, drawn.problem, drawn.network
        kind, why = f"{row['family']}, {row['policy']}", ""
        rng = np.random.default_rng([self._first + number, 80])
        if rng.random() < LIMITED and self.shares is SHARES:  # rides have limits already
            graph = replace(
                problem.graph, speed_mps=np.where(rng.random(problem.graph.num_lanes) < 0.3, rng.choice([0.1, 0.15, 0.5]), np.inf)
            )
            problem, drawn = replace(problem, graph=graph), replace(drawn, problem=replace(problem, graph=graph))
            kind += ", limits"

            def network() -> Path:
                return build_network(graph, Path(self._scratch.name) / "limits.net.xml")

        for name, method in drawn.methods:
            plan = method(problem, 2.0)
            if plan is None:
                continue
            try:
                runs = [simulate(problem, plan, replace(drawn.settings, engine=engine), network()) for engine in ENGINES]
            except (PlanError, ExecutionError) as error:
                why = plain(error)
                continue
            faults, far_m = differences(*runs, plan, drawn)
            (folder / "run.json").write_text(json.dumps(row | {"planner": name, "far_m": far_m, "wrong": faults}, indent=1, default=str))
            within = next(f"within {name}" for name, most_m in WITHIN.items() if far_m <= most_m)
            return Trial(kind, f"driven, {within}", tuple(faults), "cat run.json  # all follows from the number")
        return Trial(kind, "refused" if why else "no plan")


class EnginesInBuildings(Engines):
    """The same in whole buildings, among people."""

    shares = BUILDINGS


def differences(one: Execution, two: Execution, plan: Plan, drawn: Drawn) -> tuple[list[str], float]:
    """In what two executions of a plan do not agree, and how far robots are apart in them at most, in m."""
    problem, settings = drawn.problem, drawn.settings
    step_s, result = settings.step_length_s + 1e-6, []
    for engine, run in zip(ENGINES, (one, two)):
        judged = audit(run, problem.fleet, problem.graph.level[problem.start], drawn.walls if len(drawn.walls) else None)
        result += [f"{engine}: {what}" for what in [*map(str, judged["violations"][:1]), *run.findings[:1]]]
    if one.outcome != two.outcome or abs(one.sim_time_s - two.sim_time_s) > step_s:
        result.append(f"{one.outcome} at {one.sim_time_s:g} s, {two.outcome} at {two.sim_time_s:g} s")
    num = min(len(one.t_s), len(two.t_s))
    apart_m = np.hypot(one.x_m[:num] - two.x_m[:num], one.y_m[:num] - two.y_m[:num])
    far_m = float(np.nanmax(apart_m, initial=0.0))
    if far_m > FAR_M:
        k, robot = np.argwhere(apart_m > FAR_M)[0].tolist()
        result.append(f"robot {robot} is {apart_m[k, robot]:.4f} m apart at {one.t_s[k]:g} s, at most {far_m:.4f} m")
    if one.people is not None and two.people is not None and not _walk_alike(one.people, two.people):
        result.append("people walk other ways")
    result += _visits(one, two, problem, plan, step_s) + _events(one, two, step_s)
    return result, far_m


def _walk_alike(one: PeopleLog, two: PeopleLog) -> bool:
    if not np.array_equal(one.first, two.first):
        return False
    return bool((np.hypot(one.x_m - two.x_m, one.y_m - two.y_m) < FAR_M).all())


def _visits(one: Execution, two: Execution, problem: Problem, plan: Plan, step_s: float) -> list[str]:
    """Visits of the plan that only one makes, or another time or in another order."""
    a, b = one.arrived_s, two.arrived_s
    if (np.isfinite(a) != np.isfinite(b)).any():
        return [f"{int((np.isfinite(a) != np.isfinite(b)).sum())} visits are made by one engine only"]
    made = np.isfinite(a)
    off = np.abs(a - b)[made]
    result = [f"{int((off > step_s).sum())} visits are more than a step apart, at most {off.max():.3f} s"] if (off > step_s).any() else []
    for vertex in np.unique(plan.vertex[made]):
        here = np.flatnonzero(made & (plan.vertex == vertex))
        orders = [[plan.robot[k] for k in here[np.argsort(times[here], kind="stable")].tolist()] for times in (a, b)]
        if orders[0] != orders[1]:
            result.append(f"robots come to '{problem.graph.label(int(vertex))}' in another order")
            break
    return result


def _events(one: Execution, two: Execution, step_s: float) -> list[str]:
    """The first event that only one has."""
    first, second = ([*run.events] for run in (one, two))
    for event in first:
        same = [
            other
            for other in second
            if (other.kind, other.robot, other.vertex, other.other) == (event.kind, event.robot, event.vertex, event.other)
            and abs(other.t_s - event.t_s) <= step_s
        ]
        if not same:
            return [f"only SUMO: {event}"]
        second.remove(same[0])
    return [f"only the kinematic engine: {second[0]}"] if second else []
