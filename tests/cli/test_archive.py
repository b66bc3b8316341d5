import json

import pytest

from mrp_sumo.calibration.archive import manifest_in
from mrp_sumo.cli.main import main
from mrp_sumo.maps.catalogue import bundled_folder

LOG = "t_s,robot,x_m,y_m,action,station\n" + "".join(f"{t},a,{t * 0.5},1,{'pick' if 20 < t < 30 else ''},shelf\n" for t in range(60))


def said(capsys):
    output = capsys.readouterr()
    assert output.err == ""
    return output.out


def test_logs_become_an_archive_that_is_valid_and_calibrates(tmp_path, capsys):
    (tmp_path / "a.csv").write_text(LOG)
    (tmp_path / "b.csv").write_text(LOG.replace(",a,", ",b,").replace(",1,", ",9,"))
    logs = [str(tmp_path / name) for name in ("a.csv", "b.csv")]
    assert main(["import", "--log", *logs, "--licence", "CC0-1.0", "--out", str(tmp_path / "both"), "--json"]) == 0
    assert json.loads(said(capsys))["vehicles"] == 2
    assert main(["validate", str(tmp_path / "both"), "--json"]) == 0
    assert json.loads(said(capsys)) == {"valid": True, "faults": 0, "first": []}
    assert main(["calibrate", str(tmp_path / "both"), "--json"]) == 0
    assert json.loads(said(capsys))["kind"] == "fleet log archive"
    assert main(["export", str(tmp_path / "both"), "--archive", str(tmp_path / "x.zip"), "--anonymise", "--move"]) == 0
    assert "what remains: " in said(capsys)
    assert manifest_in(tmp_path / "x.zip")["vehicles"] == {"vehicle_1": "", "vehicle_2": ""}


def test_import_says_what_no_fleet_does(tmp_path, capsys):
    (tmp_path / "log.csv").write_text(LOG + LOG.replace(",a,", ",b,").partition("\n")[2] + "5,a,2.5,1,,\n")
    assert main(["import", "--log", str(tmp_path / "log.csv"), "--out", str(tmp_path / "made")]) == 0
    text = said(capsys)
    assert "note: states.parquet: the clock of 'a' jumps back at 59.000 s" in text
    assert "note: states.parquet: 'a' and 'b' are at the same places all the time: one vehicle of two names" in text


@pytest.mark.parametrize(
    "words, line",
    [
        (["import", "--log", "{log}"], "say where to write with --out DIR"),
        (["import", "office", "--log", "{log}", "--out", "x"], "is there beside FILE 'office'"),
        (["import"], "expected a FILE, or --log LOG"),
        (["import", "--log", "{log}", "--out", "{log}"], "is there already"),
        (["import", "--log", "{log}", "--out", "{log}.tar"], "found .tar, expected a name that ends in .zip, or the name of a folder"),
        (["export", "{log}", "--csv"], "is a file, expected a run folder"),
        (["validate", "{log}.zip"], "log.csv.zip"),
        (["validate", "{folder}"], "no manifest.json, expected a fleet log archive"),
    ],
)
def test_bad_lines_are_one_line(tmp_path, words, line, capsys):
    (tmp_path / "log.csv").write_text(LOG)
    assert main([word.format(log=tmp_path / "log.csv", folder=tmp_path) for word in words]) == 2
    error = capsys.readouterr().err
    assert line in error
    assert error.count("\n") == 1


def test_bundled_log_says_its_truth_which_intervals_hold(capsys):
    assert main(["list", "logs", "--json"]) == 0
    (entry,) = json.loads(said(capsys))
    assert entry["name"] == "warehouse_hour"
    path = bundled_folder("logs") / "warehouse_hour.zip"
    assert path.stat().st_size < 300_000
    assert main(["validate", str(path)]) == 0
    capsys.readouterr()
    assert main(["calibrate", "warehouse_hour", "--map", "warehouse", "--json"]) == 0
    figures = json.loads(said(capsys))["quantities"]
    outside = [
        name for name, truth in entry["truth"].items() if name in figures and not figures[name]["low"] <= truth <= figures[name]["high"]
    ]
    assert len(outside) <= 2  # of eleven, at 90 % each
