"""`mrp-sumo paper`, with the fewest seeds and, but for the campaign, without SUMO and with three planners."""

import json

import pytest

from mrp_sumo.cli.main import main
from mrp_sumo.experiments import paper as campaigns

ROWS = ("table_1", "table_2", "table_3", "table_4", "figure_5", "replicability")


@pytest.fixture
def small(monkeypatch):
    """Suites of three planners on the warehouse, driven without SUMO."""
    whole = campaigns.suite_of

    def suite_of(*arguments):
        suite = whole(*arguments)
        grid = suite["grid_search"] | {"map": ["warehouse"], "execution.engine": ["kinematic"]}
        grid["planner"] = [each for each in grid.get("planner", []) if not isinstance(each, str) or each in ("cbs", "ecbs", "eecbs")]
        return suite | {"grid_search": {axis: values for axis, values in grid.items() if values}}

    monkeypatch.setattr(campaigns, "suite_of", suite_of)


@pytest.mark.campaign
def test_paper_and_ours_stand_side_by_side_and_the_command_goes_on(tmp_path, capsys, small):
    assert main(["paper", "--out", str(tmp_path / "out"), "--seeds", "1", "--workers", "1"]) == 0
    output = capsys.readouterr().out
    result = check(tmp_path / "out")
    assert f"{result['runs']} runs, {result['runs']} made now" in output
    for name in ("index.html", "tables/table_3.tex", "tables/table_3.csv", "figures/figure_5_1.svg", "figures/table_3_warehouse.png"):
        assert (tmp_path / "out" / name).stat().st_size > 500, name
    assert main(["paper", "--out", str(tmp_path / "out"), "--seeds", "1", "--workers", "1"]) == 0
    assert f"{result['runs']} runs, 0 made now" in capsys.readouterr().out
    assert main(["paper", "--out", str(tmp_path / "out"), "--seeds", "1", "--workers", "1", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["file"], said["runs"], said["broken"]) == (str(tmp_path / "out" / "index.html"), result["runs"], 0)


def check(folder):
    """The document, its rows as they are to be."""
    result = json.loads((folder / "paper.json").read_text())
    assert result["seconds"] > 0
    for name in ROWS:
        for row in result[name]:
            assert {"ours", "low", "high", "paper_value"} <= row.keys()
            if row["low"] is not None:
                assert row["low"] <= row["ours"] <= row["high"]
    warehouse = {row["quantity"]: row for row in result["table_1"] if row["map"] == "warehouse" and row["cell_m"] == 0.4}
    assert (warehouse["cells"]["ours"], warehouse["cells"]["paper_value"]) == (2684, 3009)
    return result


def test_maps_that_are_not_there_are_one_line(tmp_path, capsys):
    assert main(["paper", "--out", str(tmp_path / "out"), "--maps", str(tmp_path)]) == 2
    assert capsys.readouterr().err == f"mrp-sumo: {tmp_path}: there is no office.building.yaml in it, expected an MRP-Bench checkout\n"
