"""What a map says and has no effect here is one line."""

from mrp_sumo.maps.drawing import Drawing
from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.map import unused

CROWD = "crowd_sim:\n  agent_groups:\n  - {agents_number: 0}\n  - {agents_number: 3}\n"


def test_what_has_no_effect_is_one_line(tmp_path):
    d = Drawing("hall", 10.0, 5.0)
    d.lane(d.station(1, 1, "a", dock_name="a"), d.station(9, 1, "b"))
    d.write(tmp_path / "hall.building.yaml")
    assert unused(load_map(tmp_path / "hall.building.yaml")) == "not used: dock_name: 1 (docking takes no time of its own)"
    human = d.text().replace(
        "    layers:", '      - [0, 1, {bidirectional: [4, true], graph_idx: [2, 9], orientation: [1, ""]}]\n    layers:'
    )
    (tmp_path / "crowd.building.yaml").write_text(CROWD + human)
    assert unused(load_map(tmp_path / "crowd.building.yaml")).startswith("not used: human lanes: 1, groups of crowd_sim: 1, dock_name")
