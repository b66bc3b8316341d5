"""What lifts and doors had to do, on a ride with times known by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from worlds import problem_of, two_levels

from mrp_sumo.core.execution import Event
from mrp_sumo.core.facilities import LIFT_STATES
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.retime import retime
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.metrics.facilities import METRICS, LiftUse, _use, lift_use
from mrp_sumo.metrics.metric import Evidence


def test_a_lift_is_busy_while_it_comes_and_while_a_robot_is_in_it(tmp_path):
    graph, up = two_levels(10.0, 3.0), [3, 10, 11, 12, 4]
    problem, plan = problem_of(graph, [[1, 2, *up, 5, 6, 7], [0, 0, 0, 0, 0, 0, 0, 1, 2, *up, 5, 6]])
    how = ExecutionSettings(engine="kinematic")
    run = simulate(problem, retime(problem, plan, how), how, tmp_path)
    (use,) = lift_use(run, graph)
    log = run.facilities
    stands_s = sum(  # open, with nobody in it: between the robots, and before the first is in it
        after - at for state, at, after in zip(log.lift_state.tolist(), log.lift_t_s.tolist(), log.lift_t_s.tolist()[1:]) if state == 2
    )
    ends_s = run.sim_time_s - log.lift_t_s[-1] if log.lift_state[-1] == 2 else 0.0
    assert use.busy_share == pytest.approx(1 - (stands_s + ends_s) / run.sim_time_s)
    assert (use.name, use.queue) == ("goods", 1)
    assert use.waited_s == pytest.approx(sum(e.duration_s for e in run.events if e.kind == "waited" and e.vertex == up[0]))
    assert lift_use(run, graph, since_s=run.sim_time_s) == []


@pytest.mark.parametrize(("doors", "openings"), [(("glass",), 2), ((), None)])
def test_a_door_opens_when_it_begins_to(doors, openings):
    (metric,) = (metric for metric in METRICS if metric.name == "door_openings")
    log = SimpleNamespace(door_name=doors, door_state=np.array([1, 2, 3, 0, 1, 2]))
    assert metric(Evidence(None, None, None, SimpleNamespace(facilities=log, tasks=None))) == openings


@pytest.mark.parametrize(
    ("since_s", "busy_share", "waited_s", "queue"), [(0.0, 13 / 40, 15.0, 2), (12.0, 11 / 28, 4.0, 1), (40.0, None, 0, 0)]
)
def test_a_lift_is_busy_and_waited_for_from_a_time_on(since_s, busy_share, waited_s, queue):
    """Coming from 10 s to 15 s, open until 20 s, then taken for 5 s and held for 3 s, or what of it is after 12 s; a second one rests."""
    states = [LIFT_STATES.index(name) for name in ("closed", "closed", "coming", "open", "taken", "held", "closed")]
    log = SimpleNamespace(lift_name=("goods", "other"), lift=np.array([0, 1, 0, 0, 0, 0, 0]), lift_state=np.array(states))
    log.lift_t_s = np.array([0.0, 0, 10, 15, 20, 25, 28])
    waits = [(5.0, "waited", 7.0, 1), (6.0, "waited", 4.0, 1), (6.0, "blocked", 9.0, 1), (6.0, "waited", 9.0, 0), (6.0, "waited", 9.0, -1)]
    waits.append((12.0, "waited", 4.0, 1))  # begins as the last of the others is over
    events = [Event(t_s, kind, 0, vertex, duration_s=long_s) for t_s, kind, long_s, vertex in waits]
    graph = SimpleNamespace(vertex_options=[{}, {"cabin": "goods"}, {}])
    uses = lift_use(SimpleNamespace(facilities=log, sim_time_s=40.0, events=events), graph, since_s)
    assert uses == ([] if busy_share is None else [LiftUse("goods", busy_share, waited_s, queue), LiftUse("other", 0.0, 0.0, 0)])


def test_the_busiest_lift_and_the_longest_queue_are_shown():
    uses = [LiftUse("a", 0.5, 3.0, 1), LiftUse("b", 0.25, 4.0, 2)]
    shown = {}
    for lifts in (uses, []):
        run = Evidence(None, None, None, SimpleNamespace(level=np.array([[0, 1], [1, 1], [0, 1]]), facilities=None, tasks=None))
        run._found[_use] = lifts
        shown[len(lifts)] = [metric(run) for metric in METRICS]
    assert shown == {2: [2, 7.0, 2, 0.5, None], 0: [2, None, None, None, None]}
