"""What is remembered, and when it is made again."""

import pytest

from mrp_sumo.maps import cache, load
from mrp_sumo.maps.cache import remembered

LINE = """
name: line
coordinate_system: cartesian_meters
levels:
  L1:
    vertices: [[0, 0, 0, a], [4, 0, 0, b]]
    lanes: [[0, 1, {graph_idx: [2, 0], bidirectional: [4, true]}]]
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "mrp-sumo"


@pytest.fixture
def make():
    def counted():
        counted.calls += 1
        return ["made", counted.calls]

    counted.calls = 0
    return counted


def test_the_same_content_is_made_once(folder, make):
    assert [remembered("thing", b"a", make) for _ in range(3)] == [["made", 1]] * 3
    assert remembered("thing", b"b", make) == ["made", 2]
    assert remembered("other", b"a", make) == ["made", 3]


def test_damaged_entries_are_made_again(folder, make):
    remembered("thing", b"a", make)
    (entry,) = folder.iterdir()
    entry.write_bytes(entry.read_bytes()[:5])
    assert remembered("thing", b"a", make) == ["made", 2]


def test_entry_with_a_changed_byte_is_made_again(folder, make):
    remembered("thing", b"a", make)
    (entry,) = folder.iterdir()
    content = entry.read_bytes()
    entry.write_bytes(content.replace(b"made", b"fake"))  # still a pickle
    assert remembered("thing", b"a", make) == ["made", 2]
    assert remembered("thing", b"a", make) == ["made", 2]


@pytest.mark.parametrize(("mode", "calls"), [(0o700, 1), (0o755, 1), (0o775, 2), (0o702, 2)])
def test_folder_that_others_can_write_to_is_not_used(folder, make, mode, calls):
    folder.mkdir(parents=True)
    folder.chmod(mode)
    remembered("thing", b"a", make)
    remembered("thing", b"a", make)
    assert make.calls == calls


def test_without_a_place_to_keep_things_they_are_made_every_time(tmp_path, monkeypatch, make):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert [remembered("thing", b"a", make)[1] for _ in range(2)] == [1, 2]


def test_old_entries_go_when_there_are_too_many_bytes(folder, monkeypatch):
    monkeypatch.setattr(cache, "MAX_BYTES", 2500)
    for content in (b"a", b"b", b"c", b"d"):
        remembered("thing", content, lambda: b"x" * 1000)
    assert len(list(folder.iterdir())) == 2


def test_a_large_map_comes_back_the_same(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(load, "LARGE", 10)
    path = tmp_path / "line.building.yaml"
    path.write_text(LINE)
    first, second = load.load_map(path), load.load_map(path)
    assert len(list(folder.iterdir())) == 1
    assert second.nav.xy.tolist() == first.nav.xy.tolist()
    assert not second.nav.xy.flags.writeable
    path.write_text(LINE.replace("[4, 0, 0, b]", "[5, 0, 0, b]"))
    assert load.load_map(path).nav.xy[1].tolist() == [5, 0]
