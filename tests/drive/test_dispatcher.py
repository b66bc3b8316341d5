"""A dispatcher in a user's file decides what robots do next; what it does wrong is one line that names its file."""

import numpy as np
import pytest
from worlds import drive, kinds, line

from mrp_sumo.core.execution import Outcome
from mrp_sumo.drive.dispatcher import dispatcher_of
from mrp_sumo.drive.outside_dispatcher import DispatcherError
from mrp_sumo.errors import PlugInError, ScenarioError
from mrp_sumo.plugins import registry

PATROL = '''
"""patrol.py: robots go on from their goals to their starts, and back, as often as wanted."""

import numpy as np

from mrp_sumo.core.request import Request


class Patrol:
    """There and back."""

    def __init__(self, trips: int = 1):
        self.trips = trips

    def finished(self, now_s, context):
        visits = context.ledger.visits
        return self.trips == 0 and bool((visits.reached == visits.last).all())

    def due(self, now_s, context):
        ledger, visits = context.ledger, context.ledger.visits
        if self.trips and (visits.reached == visits.last).all():
            start = visits.vertex[visits.reached]
            yield Request(
                now_s=now_s, site=ledger.problem, robot=np.arange(ledger.num_robots), start=start,
                stop_first=np.arange(ledger.num_robots + 1), stop=visits.vertex[visits.first], closed=context.closed, reason="patrol",
            )

    def answer(self, request, context):
        self.trips -= 1
        return context.plan(request)
'''


def run_with(tmp_path, text, graph=None, paths=([0, 1, 2, 3],), **settings):
    (tmp_path / "mine.py").write_text(text)
    name = f"{tmp_path / 'mine.py'}:{text.split('class ')[1].split(':')[0]}"
    return drive(tmp_path, graph or line(4), list(paths), dispatcher=name, **settings)


def test_a_file_sends_robots_on_when_they_have_arrived(tmp_path):
    run = run_with(tmp_path, PATROL)
    assert run.outcome is Outcome.COMPLETED
    assert run.x_m[-1, 0] == pytest.approx(0.0, abs=0.01) and run.x_m.max() == pytest.approx(1.2, abs=0.01)
    (reply,) = run.replies
    assert reply.reason == "patrol" and reply.vertex.tolist() == [2, 1, 0]
    assert kinds(run)["goal"] == [0, 0]  # one at each end


def test_parameters_reach_a_file(tmp_path):
    run = run_with(tmp_path, PATROL, dispatcher_parameters={"trips": 2})
    assert run.outcome is Outcome.COMPLETED and len(run.replies) == 2


def test_one_shot_is_listed_and_asks_once(tmp_path):
    assert "one_shot" in registry.names("dispatchers")
    run = drive(tmp_path, line(4), [[0, 1, 2, 3]])
    assert run.outcome is Outcome.COMPLETED and run.replies == ()


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ("7", r"mine.py:5: answer\(\) returned int, expected a Replan or None"),
        ("Replan({3: way(1)}, 'x')", r"answer\(\) sends robot 3, expected 0 to 0"),
        ("Replan({0: way(99)}, 'x')", r"answer\(\) sends robot_0 to vertex 99, which does not exist"),
        ("Replan({0: way(0)}, 'x')", r"answer\(\) sends robot_0 from 'v\d' to 'v0', where there is no lane"),
        ("Replan({0: Reroute(np.zeros(2, int), np.zeros(1), np.zeros(2), 0.0)}, 'x')", "arrays that are not one vertex"),
        ("Replan({0: Reroute(np.zeros(1, int), np.array([np.nan]), np.zeros(1), 0.0)}, 'x')", "times that are no times"),
        ("1 / 0", "mine.py:5: in answer: ZeroDivisionError"),
        ("__import__('sys').exit(0)", "SystemExit"),
    ],
)
def test_what_cannot_be_driven_is_one_line(tmp_path, answer, said):
    text = f"""
class Mine:
    def finished(self, now_s, context): return False
    def due(self, now_s, context): return [request_for(now_s, context, [0], 'x')] if now_s > 4 else []
    def answer(self, request, context): return {answer}


import numpy as np
from mrp_sumo.drive.replanning import request_for
from mrp_sumo.drive.reroute import Replan, Reroute


def way(*vertices):
    return Reroute(np.array(vertices), np.zeros(len(vertices)), np.zeros(len(vertices)), 0.0)
"""
    with pytest.raises(DispatcherError, match=said):
        run_with(tmp_path, text, time_limit_s=10.0)


def test_what_is_due_has_to_be_requests(tmp_path):
    text = """
class Mine:
    def finished(self, now_s, context): return False
    def due(self, now_s, context): return [1]
    def answer(self, request, context): return None
"""
    with pytest.raises(DispatcherError, match=r"mine.py:4: due\(\) gave int, expected a Request"):
        run_with(tmp_path, text)


def test_a_missing_method_is_named(tmp_path):
    (tmp_path / "mine.py").write_text("class Mine:\n    def finished(self, now_s, context): return True\n")
    with pytest.raises(PlugInError, match=r"mine.py:1: Mine is no dispatcher: it has no method due\(now_s, context\)"):
        dispatcher_of(f"{tmp_path / 'mine.py'}:Mine", {})


def test_an_unknown_name_is_answered_with_the_nearest():
    with pytest.raises(ScenarioError, match="unknown dispatcher 'one_sht'"):
        dispatcher_of("one_sht", {})


def test_a_robot_that_a_request_leaves_out_stays(tmp_path):
    text = PATROL.replace("robot=np.arange(ledger.num_robots)", "robot=np.array([1])").replace("start=start", "start=start[1:]")
    text = text.replace("np.arange(ledger.num_robots + 1)", "np.arange(2)").replace(
        "visits.vertex[visits.first]", "visits.vertex[visits.first[1:]]"
    )
    from worlds import graph_of

    graph = graph_of([(0, 0), (1, 0), (0, 2), (1, 2)], [(0, 1), (2, 3)])
    run = run_with(tmp_path, text, graph, [[0, 1], [2, 3]])
    assert run.outcome is Outcome.COMPLETED
    assert np.round(run.x_m[-1], 2).tolist() == [1.0, 0.0]
