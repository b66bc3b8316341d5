"""Two runs in one page: both are there, what differs is listed, and names remain text."""

import shutil

from mrp_sumo.cli.main import main


def test_page_of_two_runs_holds_both_and_lists_what_differs(folder, tmp_path, capsys):
    other = tmp_path / "other"
    shutil.copytree(folder, other)
    result = other / "result.json"
    result.write_text(result.read_text().replace('"prioritised"', '"</script><b>"'))
    assert main(["replay", str(folder), str(other), "--out", str(tmp_path / "both.html")]) == 0
    page = (tmp_path / "both.html").read_text()
    assert page.count("<iframe ") == 2
    assert "<tr><th scope=row>Planner</th><td>prioritised</td><td>&lt;/script&gt;&lt;b&gt;</td></tr>" in page
    assert "Robots</th>" not in page  # both have as many
    assert "<b>" not in page
    assert main(["replay", *[str(folder)] * 3]) == 2
    assert "3 runs, expected one or two" in capsys.readouterr().err
