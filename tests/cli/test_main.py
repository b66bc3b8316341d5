"""What holds for the options of all commands."""

import pytest

from mrp_sumo.cli.main import main


@pytest.mark.parametrize("line", ["init office --robots {} --out new", "batch suite.yaml --workers {} --dry-run"])
def test_whole_number_that_counts_nothing_is_refused_in_a_line(tmp_path, monkeypatch, capsys, line):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "suite.yaml").write_text("base: {map: office, robots: 2}\ngrid_search: {seed: [0]}\nuntil: plan\n")
    option = next(word for word in line.split() if word in ("--robots", "--workers"))
    assert main(line.format("1" + "0" * 400).split()) == 2
    command = line.split()[0]
    said = f"mrp-sumo: {option}: found a number of 401 digits, expected less than 9.22337e+18; see `mrp-sumo {command} --help`\n"
    assert capsys.readouterr().err == said
    assert main(line.format(2**63 - 1).split()) in (0, 2)
    assert "digits" not in capsys.readouterr().err
