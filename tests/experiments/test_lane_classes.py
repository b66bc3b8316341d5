"""Top speeds of types on lanes by class, in runs and as map formats give the classes."""

import numpy as np
import pytest
import yaml

from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.run import carry_out
from mrp_sumo.experiments.staging.set_up import set_up
from mrp_sumo.io.scenario.read import read_scenario
from mrp_sumo.maps.load import load_map

CART = {"length_m": 0.8, "width_m": 0.6, "max_speed_mps": 1.2, "accel_mps2": 1.0, "decel_mps2": 1.0, "turn_rate_rad_s": 1.0}
TRICYCLE = {"kind": "tricycle", "wheelbase_m": 0.6, "steering_max_rad": 1.0}
LANES = """from,to,from_x_m,from_y_m,to_x_m,to_y_m,both_ways,class
a,b,0,0,8,0,yes,hall
b,c,8,0,16,0,yes,ramp
c,d,16,0,24,0,yes,
"""


def file_of(folder, *types, **more):
    """A scenario of a robot of each type on a row of lanes; the first drives from a to d where it is alone."""
    (folder / "lanes.csv").write_text(LANES)
    goals = ["d"] if len(types) == 1 else "ad"
    scenario = {
        "map": "lanes.csv",
        "robots": [{"type": kind, "count": 1, "starts": [at], "goals": [goal]} for kind, at, goal in zip(types, "ad", goals)],
        "discretisation": {"kind": "roadmap", "cell_m": 2.0},
        "planner": "prioritised",
        **more,
    }
    path = folder / "scenario.yaml"
    path.write_text(yaml.safe_dump(scenario))
    return read_scenario(path)


@pytest.mark.parametrize("engine", ["kinematic", "sumo"])
@pytest.mark.parametrize("planner", ["continuous", "prioritised"])
@pytest.mark.parametrize("wheels", [{}, {"kinematics": TRICYCLE}], ids=["cart", "tricycle"])
def test_a_type_keeps_its_speed_on_lanes_of_a_class_and_was_planned_so(tmp_path, wheels, planner, engine):
    kind = {**CART, **wheels, "lane_class_mps": {"ramp": 0.5}}
    with MapCache() as maps:
        result = carry_out(file_of(tmp_path, kind, planner=planner, execution={"engine": engine}), maps)
    assert result.audit["passed"], result.note
    run = result.execution
    assert run.arrived_s == pytest.approx(result.plan.arrive_s, abs=0.1)
    x, speed = run.x_m[:, 0], run.speed_mps[:, 0]
    assert speed[(x > 9) & (x < 15)] == pytest.approx(0.5, abs=0.01)
    assert speed[(x > 3) & (x < 6)] == pytest.approx(1.2, abs=0.01)
    assert speed[(x > 18.5) & (x < 21)] == pytest.approx(1.2, abs=0.01)


def test_the_lowest_speed_of_several_types_holds_for_all_and_that_is_said(tmp_path):
    kinds = [{**CART, "lane_class_mps": {"ramp": 0.5}}, {**CART, "length_m": 0.7, "lane_class_mps": {"ramp": 0.3, "hall": 0.9}}]
    with MapCache() as maps:
        setup = set_up(file_of(tmp_path, *kinds), maps)
    graph = setup.problem.graph
    by_class = {options.get("class"): speed for options, speed in zip(graph.lane_options, graph.speed_mps.tolist())}
    assert by_class == {"hall": 0.9, "ramp": 0.3, None: np.inf}
    assert "types have several speeds on lanes of class hall, ramp; the lowest holds for all of them" in setup.notes


def test_a_class_that_the_map_lacks_is_said(tmp_path):
    with MapCache() as maps:
        setup = set_up(file_of(tmp_path, {**CART, "lane_class_mps": {"rmap": 0.5}}), maps)
    (line,) = [note for note in setup.notes if "class" in note]
    assert line.endswith("no lane of 'lanes' has class 'rmap' (did you mean 'ramp'?)")


PLANT = """<model version="6.0.0" name="m">
  <point name="P" positionX="0" positionY="0"/>
  <point name="Q" positionX="4000" positionY="0"/>
  <path name="P-Q" sourcePoint="P" destinationPoint="Q" length="4000" maxVelocity="1000" maxReverseVelocity="500">
    <property name="class" value="ramp"/>
  </path>
</model>"""
DRAWING = """name: drawn
levels:
  L1:
    vertices: [[0, 0, 0, p], [100, 0, 0, q]]
    lanes: [[0, 1, {bidirectional: [4, true], graph_idx: [2, 0], class: [1, ramp]}]]
    measurements: [[0, 1, {distance: [3, 4.0]}]]
"""
NETWORK = """<net version="1.9">
  <edge id="e" from="p" to="q" type="ramp"><lane id="e_0" index="0" speed="1" length="4" shape="0,0 4,0"/></edge>
  <junction id="p" x="0" y="0" type="priority"/>
  <junction id="q" x="4" y="0" type="priority"/>
</net>"""


@pytest.mark.parametrize(("name", "text"), [("a.xml", PLANT), ("a.building.yaml", DRAWING), ("a.net.xml", NETWORK)])
def test_formats_give_classes(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    assert {options.get("class") for options in load_map(tmp_path / name).nav.lane_options} == {"ramp"}
