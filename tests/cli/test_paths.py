"""Paths and disks that fail: one line, exit code 2, nothing left behind."""

import os
import resource
import subprocess
import sys

import pytest

from mrp_sumo.cli.main import main

SUITE = "base: office_5\ngrid_search: {seed: [1, 2]}\nuntil: plan\n"


@pytest.fixture(scope="module")
def office(tmp_path_factory):
    """A folder with a run and a suite."""
    folder = tmp_path_factory.mktemp("paths")
    (folder / "suite.yaml").write_text(SUITE)
    assert main(["run", "office_5", "--out", str(folder / "run")]) == 0
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("largest", [0, 2000])
@pytest.mark.parametrize(
    "command",
    [
        "run office_5 --out new",
        "plan office_5 --out new.json",
        "import office --out new",
        "generate warehouse --vertices 60 --out new.building.yaml",
        "convert office new.nav.yaml",
        "replay run --out new.html",
        "render run --at 3 --out new.png",
        "report run --out new",
        "export run --bag --out new",
        "export run --csv --out new",
        "export run --geojson --out new",
    ],
)
def test_disk_that_takes_no_file_leaves_nothing(office, tmp_path, command, largest):
    before = sorted(office.iterdir())
    ended = subprocess.run(
        [sys.executable, "-m", "mrp_sumo", *command.split()],
        capture_output=True,
        text=True,
        cwd=office,
        env={**os.environ, "XDG_CONFIG_HOME": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"},  # Python would leave caches cut off
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest)),
    )
    assert ended.returncode == 2 and sorted(office.iterdir()) == before
    assert ended.stderr.startswith("mrp-sumo: ") and ended.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "command",
    [
        "run office_5 --out PLACE",
        "plan office_5 --out PLACE.json",
        "import office --out PLACE",
        "generate warehouse --vertices 60 --out PLACE.building.yaml",
        "convert office PLACE.nav.yaml",
        "batch suite.yaml --out PLACE",
        "replay run --out PLACE.html",
        "render run --at 3 --out PLACE.png",
        "report run --out PLACE",
        "export run --csv --out PLACE",
    ],
)
@pytest.mark.parametrize("place", ["long", "circle/new", "suite.yaml/new", "/proc/new"])
def test_place_that_cannot_be_written_is_one_line(office, monkeypatch, capsys, command, place):
    monkeypatch.chdir(office)
    (office / "circle").unlink(missing_ok=True)
    (office / "circle").symlink_to("circle")
    before = sorted(office.iterdir())
    assert main(command.replace("PLACE", "x" * 300 if place == "long" else place).split()) == 2
    said = capsys.readouterr().err
    assert said.startswith("mrp-sumo: ") and said.count("\n") == 1 and len(said) < 500
    assert sorted(office.iterdir()) == before


@pytest.mark.parametrize("command", ["analyze", "replay", "status", "query", "report"])
def test_current_folder_that_holds_no_run_is_one_line(tmp_path, monkeypatch, capsys, command):
    monkeypatch.chdir(tmp_path)
    assert main([command, "."]) == 2
    said = capsys.readouterr().err
    assert said.startswith("mrp-sumo: ") and said.count("\n") == 1 and not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["..", ".", "a/b", "a" * 300, '"a\\nb"', '"a\\0b"'])
def test_scenario_whose_name_is_no_folder_is_refused(tmp_path, monkeypatch, capsys, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "case.yaml").write_text(f"name: {name}\nmap: office\nrobots: 2\n")
    assert main(["run", "case.yaml"]) == 2
    assert capsys.readouterr().err.startswith("mrp-sumo: case.yaml:1: name: ")
    assert not (tmp_path / "runs").exists()


def test_file_whose_name_is_no_folder_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name in ("...yaml", "a\nb.yaml", "a" * 210 + ".yaml"):
        (tmp_path / name).write_text("map: office\nrobots: 2\n")
        assert main(["run", name]) == 2
        said = capsys.readouterr().err
        assert "expected the name of a folder" in said and said.count("\n") == 1
    assert not (tmp_path / "runs").exists()
