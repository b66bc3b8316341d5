"""People of a scenario: who walks where, and what is refused in one line."""

import pytest
from floors import lanes

from mrp_sumo.crowd.options import ProtectiveFields
from mrp_sumo.drive.people import Bystanders
from mrp_sumo.errors import ScenarioError
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.staging.set_up import set_up
from mrp_sumo.io.scenario.read import scenario_of


def people(tmp_path, said, **more):
    document = {"map": "office", "robots": 2, "people": said, **more}
    with MapCache() as maps:
        settings = set_up(scenario_of(document, tmp_path, "people"), maps).settings
        return settings.people or settings.lane_speeds_mps


def test_a_number_is_enough(tmp_path):
    result = people(tmp_path, 20)
    assert result.count == 20 and result.fields == ProtectiveFields() and len(result.place) > 5
    assert result.floor.free[result.place].all() and (result.floor.away_m[result.place] >= 0.25).all()


def test_flows_go_between_named_places_at_the_rates_of_the_hour(tmp_path):
    flows = [{"origin": "lobby", "destination": ["pantry", "office_1"], "rate_per_h": 60, "profile": [0, 1]}]
    result = people(tmp_path, {"flows": flows, "clock_h": 11, "groups": [{"name": "staff", "speed_mps": 1.5}]})
    (flow,) = result.flows
    assert len(flow.origins) == 1 and len(flow.destinations) == 2 and result.groups[0].speed_mps == 1.5
    assert result.clock_s == 11 * 3600 and flow.arrivals.profile == (0, 1)


def test_lane_speeds_need_no_free_space(tmp_path):
    assert people(tmp_path, {"model": "lane_speeds"}) == (0.274, 0.508, 0.63)


@pytest.mark.parametrize(
    ("said", "line"),
    [
        ({}, r"people: give count, rate_per_h or flows$"),
        ({"count": 3, "rate_per_h": 2}, r"people: count and rate_per_h exclude each other$"),
        (-1, r"people(\.count)?: found -1, expected .*1"),
        ({"rate_per_h": -5}, r"people\.rate_per_h: found -5, expected .*0"),
        ({"count": 3, "places": ["loby"]}, r"people\.places\[0\]: 'loby' is not a vertex of 'office' \(did you mean 'lobby'\?\)$"),
        ({"flows": [{"origin": "lobby", "rate_per_h": 1, "to": "x"}]}, r"people\.flows\[0\]\.to: unknown key"),
        (
            {"flows": [{"destination": "pantri", "rate_per_h": 1}]},
            r"people\.flows\[0\]\.destination\[0\]: 'pantri' is not a vertex.*pantry",
        ),
        ({"count": 3, "places": ["lobby"]}, r"people: nobody can walk anywhere on 'office'"),
        ({"count": 3, "fields": {"slowest_mps": 0}}, r"people\.fields"),
        ({"model": "lane_speeds", "count": 3}, r"people: count and model: lane_speeds exclude each other: nobody walks$"),
        ({"count": 3, "corridor_m": 0.1}, r"people\.corridor_m: found 0\.1"),
    ],
)
def test_bad_input_is_one_line(tmp_path, said, line):
    with pytest.raises(ScenarioError, match=line) as refused:
        people(tmp_path, said)
    assert len(str(refused.value).splitlines()) == 1


def free_y(people):
    return people.floor.centre_of(people.floor.free.nonzero()[0])[:, 1]


def test_graph_without_walls_has_corridors_and_one_that_is_too_narrow_is_refused(tmp_path):
    nav = tmp_path / "line.yaml"
    nav.write_text(
        "building_name: line\nlevels:\n  L1:\n    lanes: [[0, 1, {}], [1, 0, {}]]\n    vertices: [[0, 0, {name: a}], [8, 0, {name: b}]]\n"
    )
    more = {"map": "line.yaml", "discretisation": "roadmap", "robots": {"starts": ["a"], "goals": ["b"]}}
    y = free_y(people(tmp_path, 3, **more))
    assert y.max() <= 0.75 and y.min() >= -0.75 and y.max() > 0.5
    with pytest.raises(ScenarioError, match=r"people: 'line' has no room for people: nowhere are 0\.5 m free between walls$"):
        people(tmp_path, {"count": 3, "corridor_m": 0.55}, **more)


CART = {"length_m": 0.8, "width_m": 0.8, "max_speed_mps": 1.0, "accel_mps2": 0.5, "decel_mps2": 0.5, "turn_rate_rad_s": 1.0}


@pytest.mark.parametrize(("loaded", "half_m"), [({}, 0.4), ({"width_m": 1.6, "length_m": 1.6}, 0.8)])
def test_people_see_loads_and_have_room_beside_them_on_graphs_without_walls(tmp_path, loaded, half_m):
    """A field of 0.2 m beside the load, and somebody of 0.5 m."""
    street = lanes(tmp_path / "street.csv", {"a": (0.0, 0.0), "b": (9.0, 0.0)}, [("a", "b")], True)
    robots = {"type": {**CART, "loaded": {"speed_mps": 0.5, **loaded}}, "starts": ["a"], "goals": ["b"]}
    document = {"map": str(street), "robots": robots, "people": {"count": 1, "fields": {"side_m": 0.2}}}
    with MapCache() as maps:
        setup = set_up(scenario_of(document, tmp_path, "loads"), maps)
    seen = Bystanders(setup.settings, setup.problem).crowd.robots
    assert seen.half_width_m == pytest.approx([half_m]) and seen.side_m == 0.2
    assert half_m + 0.2 + 0.25 < free_y(setup.settings.people).max() < half_m + 0.2 + 0.25 + 0.3
