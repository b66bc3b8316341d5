import json
import math
import zipfile
from dataclasses import replace

import pytest

from mrp_sumo.calibration.archive import MANIFEST, ArchiveHead, anonymised, faults_of, merged, read_archive, write_archive
from mrp_sumo.calibration.log import ActionTime, Charge, LoggedOrder, MotionLog
from mrp_sumo.errors import MrpSumoError

BEGIN_S = 1_700_000_000.0


def log_of(begin_s=BEGIN_S, vehicle="Berta"):
    poses = [(begin_s + t, 100.0 + 0.5 * t, 20.125, 0.25, 0.0 if t < 5 else math.nan, 1.0) for t in range(10)]
    order = LoggedOrder(
        "Auftrag 7",
        ("Regal", "Tor"),
        begin_s + 1.5,
        begin_s + 2,
        vehicle,
        ((begin_s + 3, begin_s + 4), (begin_s + 6, begin_s + 7.25)),
        begin_s + 7.25,
        begin_s + 7.25,
        {"priority": 2, "due_s": begin_s + 60, "robot": vehicle},
    )
    return MotionLog(
        "halle",
        "CSV",
        poses={vehicle: poses},
        visits=[
            ActionTime(vehicle, kind, stop, *span, begin_s + 2) for kind, stop, span in zip(("pick", "drop"), order.stops, order.services)
        ],
        orders=[order, LoggedOrder("offen", ("Tor",), begin_s + 8)],
        charges=[Charge(vehicle, begin_s + 4, 0.5, True)],
        types={vehicle: "Schlepper"},
        levels={1.0: "EG"},
    )


ABOUT = ArchiveHead(
    "halle", "CC0-1.0", who="Muster AG", where="Halle 3", levels=("EG",), types={"Schlepper": {"length_m": 1.2, "width_m": 0.8}}
)


@pytest.mark.parametrize("name", ["folder", "file.zip"])
def test_log_comes_back_from_an_archive(tmp_path, name):
    log = log_of()
    path = write_archive(log, ABOUT, tmp_path / name)
    assert faults_of(path) == []
    back = read_archive(path)
    (rows,) = back.poses.values()
    for row, expected in zip(rows, log.poses["Berta"], strict=True):
        assert row[:5] == pytest.approx(expected[:5], nan_ok=True, abs=5e-4)
    assert back.levels[rows[0][5]] == "EG"
    assert back.visits == log.visits
    assert back.types == {"Berta": "Schlepper"}
    assert back.charges == log.charges
    assert [order.asks for order in back.orders] == [log.orders[0].asks, {}]
    assert back.orders[0] == replace(log.orders[0], asks=back.orders[0].asks)
    assert (back.orders[1].name, back.orders[1].vehicle, math.isnan(back.orders[1].done_s)) == ("offen", "", True)
    with pytest.raises(MrpSumoError, match="is there already"):
        write_archive(log, ABOUT, path)


def test_anonymised_archive_has_no_name_date_or_place_of_the_log(tmp_path):
    log, about = anonymised(log_of(), ABOUT, moved=True)
    folder = write_archive(log, about, tmp_path / "log")
    content = b"".join(path.read_bytes() for path in folder.iterdir())
    for name in (b"Berta", b"Auftrag", b"offen", b"Regal", b"Tor", b"Schlepper", b"EG", b"Muster", b"Halle", b"halle"):
        assert name not in content
    back = read_archive(folder)
    assert [row[:3] for row in back.poses["vehicle_1"][:2]] == [(0.0, 0.0, 0.125), (1.0, 0.5, 0.125)]
    order = back.orders[0]
    assert (order.release_s, order.done_s, order.stops) == (1.5, 7.25, ("station_1", "station_2"))
    assert order.asks == {"priority": 2, "due_s": 60.0, "robot": "vehicle_1"}
    assert json.loads((folder / MANIFEST).read_text())["robot_types"] == {"type_1": {"length_m": 1.2, "width_m": 0.8}}


def changed(folder, **keys):
    document = json.loads((folder / MANIFEST).read_text())
    (folder / MANIFEST).write_text(json.dumps({key: value for key, value in (document | keys).items() if value is not None}))


@pytest.mark.parametrize(
    "keys, line",
    [
        ({"version": 2}, "manifest.json: version 2, expected 1"),
        ({"format": "other"}, "manifest.json: format: expected 'mrp_sumo fleet log'"),
        ({"vehicles": None, "vehicels": {}}, "no 'vehicles' (did you mean 'vehicels'?)"),
        ({"licence": 3}, "licence: found int, expected str"),
    ],
)
def test_manifest_of_something_else_is_one_line(tmp_path, keys, line):
    folder = write_archive(log_of(), ABOUT, tmp_path / "log")
    changed(folder, **keys)
    with pytest.raises(MrpSumoError) as error:
        read_archive(folder)
    assert line in str(error.value)
    assert "\n" not in str(error.value)


def test_validator_names_what_is_wrong(tmp_path):
    log = log_of()
    log.poses["Berta"].append((BEGIN_S + 5, 900.0, 20.0, 0.0, math.nan, 1.0))
    log.orders[1] = replace(log.orders[1], name="Auftrag 7")
    folder = write_archive(log, ABOUT, tmp_path / "log")
    changed(folder, licence="", vehicles={"Anton": "Schlepper"})
    (folder / "events.parquet").write_bytes((folder / "orders.parquet").read_bytes())
    with pytest.raises(MrpSumoError, match=r"events.parquet: no column 'begin_ms'"):
        faults_of(folder)
    folder = write_archive(log, ABOUT, tmp_path / "log2")
    changed(folder, licence=" ", vehicles={"Anton": "Schlepper"}, tables={}, time={"base": "of the log", "begin_ms": 0, "end_ms": 0})
    faults = "\n".join(faults_of(folder))
    for line in (
        "licence: nothing",
        "events.parquet: its SHA-256 is not that of manifest.json",
        "vehicles: no 'Berta'",
        "the clock of 'Berta' jumps back",
        "'Berta' is at two places at once",
        "two orders 'Auftrag 7'",
        "no pose of 'Anton', which manifest.json has",
        "time: begin_ms, end_ms: not the first and the last of states.parquet",
    ):
        assert line in faults


@pytest.mark.parametrize(
    "times, is_odd",
    [
        ({}, False),
        ({"done_s": BEGIN_S + 1}, True),  # before it was released
        ({"services": ((BEGIN_S - 30, BEGIN_S - 20), (BEGIN_S - 15, BEGIN_S - 10))}, False),  # by a clock that is slow
        ({"services": ((BEGIN_S + 5, BEGIN_S + 6), (BEGIN_S + 4, BEGIN_S + 7))}, True),
        ({"services": ((BEGIN_S - 3600, BEGIN_S - 3590), (BEGIN_S - 3580, BEGIN_S - 3570))}, True),
    ],
)
def test_services_may_be_by_another_clock_than_orders_but_follow_each_other(tmp_path, times, is_odd):
    log = log_of()
    log.orders[0] = replace(log.orders[0], **times)
    faults = faults_of(write_archive(log, ABOUT, tmp_path / "log"))
    assert faults == (["orders.parquet: 'Auftrag 7': its times do not follow each other"] if is_odd else [])


def test_zip_with_other_members_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "evil.zip", "w") as pack:
        pack.writestr("../manifest.json", "{}")
    with pytest.raises(MrpSumoError, match="is no file of an archive"):
        read_archive(tmp_path / "evil.zip")
    (tmp_path / "torn.zip").write_bytes(b"PK\x03\x04 not one")
    with pytest.raises(MrpSumoError, match="not a readable ZIP"):
        read_archive(tmp_path / "torn.zip")


def test_logs_of_two_days_become_one():
    both = merged([log_of(), log_of(BEGIN_S + 3600), log_of(vehicle="Anton")])
    assert {name: len(rows) for name, rows in both.poses.items()} == {"Berta": 20, "Anton": 10}
    assert sorted(order.name for order in both.orders) == ["Auftrag 7", "Auftrag 7_2", "Auftrag 7_3", "offen", "offen_2", "offen_3"]
    assert set(both.levels.values()) == {"EG"}


def test_a_log_does_not_go_on_with_itself_but_may_with_its_last_pose():
    with pytest.raises(MrpSumoError, match="halle: poses of 'Berta' are those of halle: the same log twice"):
        merged([log_of(), log_of()])
    assert len(merged([log_of(), log_of(BEGIN_S + 9)]).poses["Berta"]) == 20
