import os
import socket
from pathlib import Path

import pytest

from mrp_sumo.cli.main import main
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.files.reading import read_bytes, read_json, require_regular


def fifo(path):
    os.mkfifo(path)
    return path


def bound_socket(path):
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(path))
    return path


def circle(path):
    path.symlink_to(path)
    return path


@pytest.mark.parametrize(
    ("made", "line"),
    [
        (fifo, "is a FIFO, expected a file"),
        (bound_socket, "is a socket, expected a file"),
        (circle, "its symbolic links lead in a circle"),
        (lambda path: Path("/dev/zero"), "is a device, expected a file"),
        (lambda path: path.parent, "is a folder, expected a file"),
        (lambda path: path.parent / ("x" * 300), "the name is too long"),
    ],
)
def test_what_is_no_regular_file_is_refused_before_it_is_opened(tmp_path, made, line):
    for read in (read_bytes, require_regular):
        path = tmp_path / read.__name__
        with pytest.raises(MrpSumoError, match=line) as refused:
            read(made(path))
        assert len(str(refused.value)) < 400


def test_file_above_the_limit_is_not_read(tmp_path):
    (tmp_path / "large").write_bytes(b"12345")
    assert read_bytes(tmp_path / "large", 5) == b"12345"
    with pytest.raises(MrpSumoError, match="5 bytes; above 4 bytes nothing is read"):
        read_bytes(tmp_path / "large", 4)
    with pytest.raises(MrpSumoError, match="more than 4 bytes"):  # /proc has sizes of 0
        read_bytes(Path("/proc/self/status"), 4)


def test_deep_nesting_is_refused_in_a_line(tmp_path):
    (tmp_path / "deep.json").write_text("[" * 200_000)
    with pytest.raises(MrpSumoError, match="nested too deep"):
        read_json(tmp_path / "deep.json")


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", "FILE", "--out", "never"],
        ["plan", "FILE"],
        ["plan", "--map", "FILE", "--robots", "2"],
        ["plan", "--map", "PLAIN.map", "--scen", "FILE"],
        ["validate", "FILE", "--scenario", "office_9"],
        ["validate", "PLAIN.map", "--scenario", "FILE"],
        ["import", "FILE", "--check"],
        ["batch", "FILE", "--out", "never"],
        ["convert", "FILE", "out.yaml"],
        ["analyze", "FILE"],
        ["analyze", "BAG", "--config", "FILE"],
        ["query", "FILE"],
    ],
)
@pytest.mark.parametrize("kind", ["fifo", "device", "circle", "long"])
def test_every_command_refuses_odd_files_in_one_line(tmp_path, monkeypatch, capsys, arguments, kind):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "PLAIN.map").write_text("type octile\nheight 2\nwidth 2\nmap\n..\n..\n")
    (tmp_path / "BAG").mkdir()
    odd = {"device": "/dev/zero", "long": "x" * 5000}.get(kind, "odd")
    if kind in ("fifo", "circle"):
        (fifo if kind == "fifo" else circle)(tmp_path / "odd")
    before = sorted(tmp_path.iterdir())
    assert main([odd if a == "FILE" else a for a in arguments]) == 2
    said = capsys.readouterr().err
    assert said.startswith("mrp-sumo: ") and said.count("\n") == 1 and len(said) < 500
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("[" * 100_000, "nested deeper than 30 levels"),
        ("{a: " * 100_000, "nested deeper than 30 levels"),
        (
            "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]\n" for k in range(1, 12)),
            "aliases",
        ),
        ("a: &a [*a]\n", "alias '\\*a' has no anchor before it"),
        ("a: !!python/object/apply:os.system [true]\n", "tag 'tag:yaml.org,2002:python/object/apply:os.system' is not read"),
    ],
)
@pytest.mark.parametrize("reading", ["scenario", "suite", "robot type"])
def test_yaml_of_strangers_is_read_guarded(tmp_path, monkeypatch, text, line, reading):
    from mrp_sumo.experiments.suite import read_suite
    from mrp_sumo.io.scenario.read import read_scenario
    from mrp_sumo.io.scenario.robots import robot_type

    (tmp_path / "odd.yaml").write_text(text)
    read = {
        "scenario": read_scenario,
        "suite": read_suite,
        "robot type": lambda path: robot_type(path.name, tmp_path / "bundled", tmp_path),
    }[reading]
    with pytest.raises(MrpSumoError, match=f"odd.yaml:\\d+: .*{line}"):
        read(tmp_path / "odd.yaml")


def test_half_of_a_character_is_refused(tmp_path):
    path = tmp_path / "names.json"
    path.write_text(r'{"whole": "\ud83d\ude80", "no escape": "\\ud83d"}')
    assert read_json(path) == {"whole": "\U0001f680", "no escape": r"\ud83d"}
    path.write_text(r'{"half": "\ud83d"}')
    with pytest.raises(MrpSumoError, match="not JSON: 'utf-8' codec can't encode"):
        read_json(path)
