"""YAML as people edit it: what is touched changes, everything else keeps its bytes."""

from pathlib import Path

import pytest

from mrp_sumo.maps.yaml_edit import document_of, edited
from mrp_sumo.maps.yaml_text import Text

SMALL = """# a hall
name: hall
levels:
  L1:
    elevation: 0   # ground
    vertices:
      - [0, 0, 0, dock]  # the first
      - [10.50, 0, 0, ""]
      - - 20
        - 0
        - 0
        - far
    lanes:
      - [0, 1, {graph_idx: [2, 0], bidirectional: [4, true]}]
      # a lane that somebody doubts
      - [1, 2, {graph_idx: [2, 0], bidirectional: [4, true]}]
    mine: {kept: as it is}
    walls: []
lifts: {}
"""


def of(text):
    return Text(Path("hall.building.yaml"), text)


def test_what_is_not_touched_keeps_its_bytes():
    document = document_of(of(SMALL))
    assert edited(of(SMALL), document) == SMALL
    document["levels"]["L1"]["vertices"][1][0] = 11
    document["levels"]["L1"]["walls"] = [[0, 2, {}]]
    document["levels"]["L1"]["doors"] = [[0, 1, {"name": [1, "gate"]}]]
    changed = SMALL.replace('[10.50, 0, 0, ""]', '[11, 0, 0, ""]').replace("    walls: []\n", "    walls:\n      - [0, 2, {}]\n")
    assert edited(of(SMALL), document) == changed.replace("lifts: {}", "    doors:\n      - [0, 1, {name: [1, gate]}]\nlifts: {}")


def test_items_come_and_go_on_lines_of_their_own():
    document = document_of(of(SMALL))
    level = document["levels"]["L1"]
    level["vertices"] = [[5, 5, 0, "new"], *level["vertices"][1:], [7, 7, 0, "last"]]
    del level["lanes"][0], level["mine"]
    text = edited(of(SMALL), document)
    assert "      - [5, 5, 0, new]  # the first\n" in text
    assert "        - far\n      - [7, 7, 0, last]\n    lanes:\n      # a lane" in text.replace(", bidirectional", ", bidirectional")
    assert "mine" not in text
    assert document_of(of(text)) == document


@pytest.mark.parametrize("breaks", ["\r\n", "\n"])
def test_names_and_line_breaks_of_others_survive(breaks):
    text = SMALL.replace("dock", '"dök \U0001f69a"').replace("\n", breaks)
    document = document_of(of(text))
    document["levels"]["L1"]["vertices"][1][3] = "yes"
    assert edited(of(text), document) == text.replace('[10.50, 0, 0, ""]', '[10.5, 0, 0, "yes"]')


def test_what_cannot_be_patched_is_written_anew():
    text = SMALL.replace("- [0, 0, 0, dock]", "- &first [0, 0, 0, dock]").replace('- [10.50, 0, 0, ""]', "- *first")
    document = document_of(of(text))
    document["levels"]["L1"]["vertices"][0] = [1, 1, 0, "other"]
    assert document_of(of(edited(of(text), document))) == document
