"""`mrp-sumo demo`: a minute that shows everything."""

import json
from pathlib import Path

import pytest

from mrp_sumo.cli.main import main


@pytest.mark.slow
def test_demo_makes_a_page_that_leads_to_all_it_made(tmp_path, capsys):
    assert main(["demo", "--out", str(tmp_path / "demo"), "--json"]) == 0
    output = capsys.readouterr()
    said = json.loads(output.out)
    page = Path(said["page"])
    for place in ("office/replay.html", "warehouse/replay.html", "planners/report/index.html"):
        assert place in page.read_text() and (page.parent / place).is_file()
    assert said["runs"] == 8 and "$ mrp-sumo run office_9" in output.err
