"""Scenarios without files."""

import numpy as np
import pytest

import mrp_sumo as ms


def refusal(call):
    with pytest.raises(ms.MrpSumoError) as caught:
        call()
    return str(caught.value).splitlines()


def test_short_forms_say_what_a_file_says(tmp_path):
    path = tmp_path / "office_9.yaml"
    path.write_text("map: office\nrobots: {count: 9}\nplanner: {name: eecbs}\nseed: 3\n")
    made = ms.Scenario(map="office", robots=9, planner="eecbs", seed=3)
    assert made.values == ms.Scenario.read(path).values
    assert repr(made) == "<Scenario office_9: office, 9 robots, eecbs, adg, seed 3>"


def test_numbers_of_numpy_and_sections_are_taken():
    made = ms.Scenario("office", robots={"count": np.int64(4)}, seed=np.int64(2), execution={"policy": "timed"}, discretisation="roadmap")
    assert (made.seed, made.values["robots"]["count"], made.values["execution"]["policy"]) == (2, 4, "timed")
    assert made.values["discretisation"]["kind"] == "roadmap"


def test_unknown_keys_are_refused_with_the_nearest():
    assert refusal(lambda: ms.Scenario(map="office", robot=9)) == [
        "scenario: robots: missing",
        "scenario: robot: unknown key (did you mean 'robots'?)",
    ]
    made = ms.Scenario("office", 3)
    assert refusal(lambda: made.replace(planer="pibt")) == ["planer: unknown key (did you mean 'planner'?)"]
    assert refusal(lambda: made.replace(execution={"polcy": "adg"})) == ["execution.polcy: unknown key (did you mean 'policy'?)"]


def test_replacing_a_key_leaves_the_rest_and_the_original():
    made = ms.Scenario("office", 3, {"name": "ecbs", "time_limit_s": 5, "parameters": {"w": 1.3}}, execution={"time_limit_s": 99})
    other = made.replace(execution={"policy": "timed"}, seed=7, robots=2)
    assert other.values["execution"] == {**made.values["execution"], "policy": "timed"}
    assert (other.seed, other.values["robots"]["count"], made.seed, made.values["robots"]["count"]) == (7, 2, 0, 3)
    assert other.values["planner"] == made.values["planner"]


def test_another_planner_comes_with_its_own_parameters():
    made = ms.Scenario("office", 3, {"name": "ecbs", "time_limit_s": 5, "parameters": {"w": 1.3}})
    chosen = made.replace(planner="pibt").values["planner"]
    assert (chosen["name"], chosen["parameters"], chosen["time_limit_s"]) == ("pibt", {}, 5)
    assert made.replace(planner={"time_limit_s": 9}).values["planner"]["parameters"] == {"w": 1.3}


def test_bundled_scenario_is_found_by_name():
    assert ms.Scenario.read("office_9").values["robots"]["count"] == 9
    assert refusal(lambda: ms.Scenario.read("office_8")) == ["office_8: no such file (did you mean 'office_9'?)"]


def test_relative_paths_begin_in_the_folder_given(tmp_path):
    (tmp_path / "small.map").write_text("type octile\nheight 2\nwidth 3\nmap\n...\n...\n")
    assert ms.problem(ms.Scenario("small.map", 2, folder=tmp_path)).graph.num_vertices == 6


def test_scenario_prints_and_shows_itself():
    made = ms.Scenario("office", 3, {"name": "ecbs", "parameters": {"w": 1.3}})
    assert "ecbs, at most 60 s" in str(made) and "1.3" in str(made)
    assert "<table>" in made._repr_html_()


def test_starts_of_a_scenario_with_tasks_can_be_replaced_alone():
    mapd = ms.Scenario.read("mapd_lifelong")
    assert mapd.replace(robots={"starts": ["v37", "v40"]}).values["robots"]["goals"] == ["v37", "v40"]
    with pytest.raises(ms.MrpSumoError, match="goals and tasks exclude each other"):
        mapd.replace(robots={"starts": ["v37", "v40"], "goals": ["v40", "v37"]})
