"""A plan in the words of Open-RMF's next generation: robots that obey its blockers pass in the order of the plan, however late they are."""

import json

import numpy as np
import pytest
from wire.worlds import driven

from mrp_sumo.cli.main import main


@pytest.fixture(scope="module")
def document(tmp_path_factory):
    """Of two carts that swap places, one of which waits for the other."""
    run = driven(tmp_path_factory.mktemp("rmf_plans"))
    assert main(["export", str(run), "--rmf-plans"]) == 0
    return json.loads((run / "rmf_plans.json").read_text())


def test_members_are_those_of_the_messages(document):
    plan = document["plans"][0]["plan"]
    assert set(plan) == {"waypoints", "start_time", "plan_id", "workflow"} and document["experimental"]
    assert set(plan["waypoints"][0]) == {
        *("position", "arrival_constraints", "progress", "maps", "departure_blockers"),
        *("departure_trajectory", "departure_action", "arrival_action"),
    }
    assert len(plan["plan_id"]["destination_session"]["uuid"]) == 16
    for one in document["plans"]:
        progress = np.float32([waypoint["progress"] for waypoint in one["plan"]["waypoints"]])
        assert (np.diff(progress) > 0).all()
    last = {release["name"]: release["release"]["waypoint_id"] for release in document["releases"]}
    assert last == {one["name"]: len(one["plan"]["waypoints"]) - 1 for one in document["plans"]}


@pytest.mark.parametrize("seed", range(5))
def test_robots_that_obey_blockers_arrive_and_never_share_a_place(document, seed):
    """Robots step along their waypoints at random, and leave none whose blockers have not come far enough."""
    rng = np.random.default_rng(seed)
    plans = {one["name"]: one["plan"]["waypoints"] for one in document["plans"]}
    assert any(waypoint["departure_blockers"] for route in plans.values() for waypoint in route)
    at = dict.fromkeys(plans, 0)
    while any(at[name] < len(route) - 1 for name, route in plans.items()):
        free = [
            name
            for name, route in plans.items()
            if at[name] < len(route) - 1
            and all(plans[b["name"]][at[b["name"]]]["progress"] >= b["required_progress"] for b in route[at[name]]["departure_blockers"])
        ]
        assert free, "nobody may go on"
        at[str(rng.choice(free))] += 1
        places = np.array([plans[name][k]["position"] for name, k in at.items()])
        assert np.hypot(*(places[0] - places[1])) >= 1.0 - 1e-9, "a cell apart"
