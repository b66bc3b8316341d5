"""The server of a workbench: for this machine and its own page alone, and a face of the commands."""

import json
import shutil
import threading
import urllib.error
import urllib.request

import pytest

from mrp_sumo.cli.main import main
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.maps.catalogue import bundled_maps
from mrp_sumo.studio.commands import first_map, words_of
from mrp_sumo.studio.server import Studio
from mrp_sumo.studio.workspace import Workspace


@pytest.fixture
def studio(tmp_path):
    shutil.copy(bundled_maps()["office"], tmp_path)
    studio = Studio(tmp_path, "office.building.yaml")
    thread = threading.Thread(target=studio.server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
    thread.start()
    yield studio
    studio.server.shutdown()
    studio.close()


def ask(studio, place, values=None, **headers):
    """Status and body of an answer; JSON where it is."""
    return at(f"{studio.address}{place}", None if values is None else json.dumps(values).encode(), **headers)


def at(address, data=None, **headers):
    request = urllib.request.Request(address, data, headers)
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            status, body, kind = answer.status, answer.read(), answer.headers["Content-Type"]
    except urllib.error.HTTPError as error:
        with error:
            status, body, kind = error.code, error.read(), error.headers["Content-Type"]
    return status, json.loads(body) if kind == "application/json" else body.decode()


def test_the_page_needs_nothing_from_elsewhere(studio):
    scripts = (
        "main",
        "shared",
        "panels",
        "draw",
        "ask",
        "plan",
        "parts",
        "tools",
        "view",
        "site",
        "levels",
        "api",
        "elements",
        "constants",
    )
    names = ["", "page.css", *(f"{name}.js" for name in scripts)]
    texts = [ask(studio, name) for name in names]
    assert all(status == 200 for status, _ in texts)
    assert sum(len(text) for _, text in texts) < 1_000_000
    assert not any("https://" in text or "http://" in text.replace("http://www.w3.org/2000/svg", "") for _, text in texts)
    assert ask(studio, "no.js")[0] == ask(studio, "../server.py")[0] == ask(studio, "api/nothing")[0] == 404


def test_nobody_else_is_let_in(studio):
    root = studio.address.rsplit("/", 2)[0]
    for place in ("api/files", "x/api/files"):
        assert at(f"{root}/{place}")[0] == 403
    assert ask(studio, "api/files", Origin="https://example.org")[0] == 403
    assert ask(studio, "api/save", {"path": "x.building.yaml", "document": {}, "digest": ""}, Origin="null")[0] == 403
    assert ask(studio, "api/files", Host="example.org")[0] == 403
    assert ask(studio, "api/files")[0] == 200


def test_a_map_is_opened_checked_and_saved(studio, tmp_path):
    _, opened = ask(studio, "api/open?path=office.building.yaml")
    document = opened["document"]
    status, result = ask(studio, "api/check", {"path": opened["path"], "document": document})
    assert (status, result["refused"]) == (200, False)
    document["levels"]["L1"]["vertices"][0][3] = "renamed"
    status, saved = ask(studio, "api/save", {"path": opened["path"], "document": document, "digest": opened["digest"]})
    assert status == 200 and "renamed" in (tmp_path / "office.building.yaml").read_text()
    status, conflict = ask(studio, "api/save", {"path": opened["path"], "document": document, "digest": opened["digest"]})
    assert status == 409 and "nothing was written" in conflict["error"]
    assert ask(studio, "api/digest?path=office.building.yaml")[1] == saved


@pytest.mark.parametrize(
    ("place", "values", "why"),
    [
        ("api/open?path=none.yaml", None, "no such file"),
        ("api/open?path=../..", None, "outside"),
        ("api/layers?path=office.building.yaml", None, "has no layers"),
        ("api/open?path=office.building.yaml&layers=WALLS", None, "layers: expected a list"),
        ("api/save", {"path": "office.building.yaml"}, "nothing was written"),
        ("api/start", {"what": "rm"}, "unknown command 'rm'"),
        ("api/start", {"what": "run", "scenario": "none.yaml"}, "none.yaml: is not there"),
        ("api/stop", {"number": "7"}, "no command 7"),
        ("api/propose", {"plan": "office.building.yaml", "pitch_m": "x"}, "pitch_m: expected a number"),
        ("api/scenario", {"path": "day.yaml", "text": "[1]", "key": "a", "value": 1}, "expected keys and values"),
    ],
)
def test_what_cannot_be_is_said_in_a_line(studio, place, values, why):
    status, said = ask(studio, place, values)
    assert status in (400, 409)
    assert why in said["error"] and "\n" not in said["error"]


def test_a_file_is_added_once(studio, tmp_path):
    address = f"{studio.address}add?path=hall%20b.png"
    assert [at(address, data)[0] for data in (b"1", b"2")] == [200, 409]
    assert (tmp_path / "hall b.png").read_bytes() == b"1"
    assert at(f"{studio.address}add?path=../x.png", b"1")[0] == at(f"{studio.address}add", b"1")[0] == 400


def test_bodies_that_are_no_objects_are_refused(studio):
    for body in (b"{", b"[1]", b"\xff", b"[" * 2000):
        assert at(f"{studio.address}api/check", body)[0] == 400


def test_pages_of_the_folder_run_no_scripts_here(studio, tmp_path):
    (tmp_path / "page.html").write_text("<script>alert(1)</script>")
    with urllib.request.urlopen(f"{studio.address}page?path=page.html", timeout=60) as answer:
        assert answer.headers["Content-Security-Policy"].startswith("sandbox;")
    assert ask(studio, "page?path=office.building.yaml")[0] == 400


def test_a_command_is_started_watched_and_named(studio, tmp_path):
    _, job = ask(studio, "api/start", {"what": "convert", "map": "office.building.yaml", "format": "lif"})
    assert job["command"] == "mrp-sumo convert office.building.yaml office.lif.json"
    studio.jobs.of(str(job["number"]))._process.wait(120)
    (ended,) = ask(studio, "api/commands")[1]
    assert (ended["state"], ended["code"]) == ("done", 0)
    assert ended["compiled"][1] > 0  # kernels that there are
    assert (tmp_path / "office.lif.json").is_file()


def test_names_of_files_are_never_options(tmp_path):
    workspace = Workspace(tmp_path.resolve())
    (tmp_path / "--out").write_text("")
    words, out = words_of(workspace, {"what": "run", "scenario": "--out"})
    assert words[:2] == ["run", "./--out"] and not out.startswith("-")
    with pytest.raises(MrpSumoError, match="expected two maps that differ"):
        words_of(workspace, {"what": "variants", "scenario": "--out", "maps": ["--out", "--out"]})


def test_two_layouts_are_a_suite_whose_folder_may_be_moved(tmp_path):
    workspace = Workspace(tmp_path.resolve())
    for name in ("a.building.yaml", "b.building.yaml", "day/scenario.yaml"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("")
    values = {"what": "variants", "scenario": "day/scenario.yaml", "maps": ["a.building.yaml", "b.building.yaml"], "seeds": 3}
    words, out = words_of(workspace, values)
    assert words == ["batch", "variants/a_to_b.yaml", "--out", "variants/a_to_b"]
    text = (tmp_path / "variants/a_to_b.yaml").read_text()
    assert "../day/scenario.yaml" in text and str(tmp_path) not in text
    assert first_map(workspace, out) == "../a.building.yaml"
    assert first_map(workspace, "variants/none") == ""


def test_a_drawing_that_nobody_reads_is_refused_before_a_page_opens(tmp_path, capsys):
    (tmp_path / "hall.dwg").write_bytes(b"AC1032\0\0")
    assert main(["studio", str(tmp_path / "hall.dwg"), "--no-browser"]) == 2
    assert capsys.readouterr().err.endswith("hall.dwg: an AutoCAD drawing (DWG), which CAD programs alone read: save it as DXF there, or "
                                            "with LibreCAD, FreeCAD or the ODA File Converter\n")  # fmt: skip


def test_a_map_that_is_not_there_is_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["studio", "offise", "--no-browser"]) == 2
    assert capsys.readouterr().err == "mrp-sumo: no map 'offise': neither a file nor a bundled map (did you mean 'office'?)\n"
    assert main(["studio", "--port", "x"]) == 2
