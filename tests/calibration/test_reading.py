import json
import math
from pathlib import Path

import pytest

from mrp_sumo.calibration.log import MotionLog, require_here
from mrp_sumo.calibration.reading import read_fleet
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.maps.catalogue import find_map
from mrp_sumo.maps.load import load_map


def states(path, documents):
    path.write_text("\n".join(map(json.dumps, documents)) + "\n")
    return path


def state(second, **more):
    place = {"x": 1.0 + second, "y": 2.0, "theta": 0.5, "mapId": "L1"}
    return {"timestamp": f"2026-01-01T00:00:{second:02d}.000Z", "serialNumber": "agv", "agvPosition": place, **more}


@pytest.mark.parametrize(
    "head, scale", [("t_s,robot,x_m,y_m,yaw_rad", 1.0), ("t,vehicle,x,y,theta", 1.0), ("t_s,robot,x_mm,y_mm,yaw", 1000.0)]
)
def test_columns_say_their_units(tmp_path, head, scale):
    path = tmp_path / "poses.csv"
    path.write_text(f"{head}\n" + "\n".join(f"{k},a,{k * scale},{2 * scale},0.1" for k in range(5)))
    assert read_fleet(path).poses["a"][3][:4] == pytest.approx((3.0, 3.0, 2.0, 0.1))


def test_degrees_and_milliseconds(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("t_ms;x;y;yaw_deg\n" + "\n".join(f"{k * 1000};1;2;90" for k in range(5)))
    assert read_fleet(path).poses["robot"][2][:4] == pytest.approx((2.0, 1.0, 2.0, math.pi / 2))


@pytest.mark.parametrize("first", ["", "sep=;\n"])
def test_spreadsheets_with_decimal_commas_are_read(tmp_path, first):
    path = tmp_path / "poses.csv"
    path.write_text(f"{first}Time (s);vehicleId;X [m];posY;yaw_deg\n" + "\n".join(f"{k},5;agv 1;{k},25;-2,0;90" for k in range(5)))
    assert read_fleet(path).poses["agv 1"][3][:4] == pytest.approx((3.5, 3.25, -2.0, math.pi / 2))


def test_levels_whose_names_begin_alike_are_others(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("t_s,x_m,y_m,level\n" + "\n".join(f"{k},0,0,Level_{1 + k // 2 % 2}" for k in range(6)))
    log = read_fleet(path)
    assert [log.levels[row[5]] for row in log.poses["robot"]] == ["Level_1", "Level_1", "Level_2", "Level_2", "Level_1", "Level_1"]
    states(tmp_path / "log.jsonl", [state(k) | {"agvPosition": {"x": k, "y": 0, "theta": 0, "mapId": f"Level_{k // 3}"}} for k in range(6)])
    log = read_fleet(tmp_path / "log.jsonl")
    assert [log.levels[row[5]] for row in log.poses["agv"]] == ["Level_0"] * 3 + ["Level_1"] * 3


def test_dates_are_times(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("timestamp,x,y\n" + "\n".join(f"2026-01-31T08:00:0{k}.500Z,{k},0" for k in range(5)))
    times = [row[0] for row in read_fleet(path).poses["robot"]]
    assert [t - times[0] for t in times] == pytest.approx([0, 1, 2, 3, 4])


@pytest.mark.parametrize(
    "text, line",
    [
        ("t_s,robot,x_m,yaw\n", "poses.csv:1: no column 'y_m' (did you mean 'x_m'?)"),
        ("t_s,x_m,y_m\n0,1,2\n1,one,2\n", "poses.csv:3: x_m: found 'one', expected a number"),
        ("t_s,x_m,y_m\n", "no row says where a vehicle is"),
        (
            "time,x,y\n31.01.2026 08:00:00,1,2\n",
            "t_s: found '31.01.2026 08:00:00', expected seconds, or a date such as 2026-01-31T08:00:00Z",
        ),
        ('t_s,x_m,y_m\n"1,5",1,2\n', "poses.csv:2: t_s: found '1,5'"),
        ("t_s,x_m,y_m\n1,0,2,5,3,0\n", "poses.csv:2: found 6 cells, expected 3, as in the first line; decimal commas need semicolons"),
        ("t_s,x_m\0,y_m\n", "poses.csv: not text in UTF-8, expected a CSV"),
        ("t_s,x_m,y_m\n0,1e9,2\n", "expected metres of a floor"),
        (
            "timestamp,x,y\n1764230400480,1,2\n",
            "poses.csv:2: t_s: found 1764230400480, expected seconds; a column of milliseconds is called t_ms",
        ),
        ("timestamp,x,y\n1764230400480000000,1,2\n", "poses.csv:2: t_s: found 1764230400480000000, expected seconds"),
    ],
)
def test_bad_csv_is_one_line(tmp_path, text, line):
    path = tmp_path / "poses.csv"
    path.write_text(text)
    with pytest.raises(MrpSumoError) as error:
        read_fleet(path)
    assert line in str(error.value)
    assert "\n" not in str(error.value)


def test_payload_that_a_recorder_has_as_text_is_read(tmp_path):
    path = states(tmp_path / "messages.jsonl", [{"topic": "uagv/v2/KIT/agv/state", "payload": json.dumps(state(k))} for k in range(5)])
    assert [row[1] for row in read_fleet(path).poses["agv"]] == [1.0, 2.0, 3.0, 4.0, 5.0]


def test_headings_in_degrees_are_one_line(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("t,x,y,yaw\n" + "\n".join(f"{k},{k},0,{90 * (k // 4 % 4)}" for k in range(40)))
    with pytest.raises(MrpSumoError, match="the heading of 'robot' leaps by 270 rad: degrees, expected radians"):
        read_fleet(path).tracks()


def test_vehicles_of_one_name_are_at_two_places_even_at_equal_times(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("t,x,y\n" + "\n".join(f"{k},{k},0\n{k},{k},50" for k in range(40)))
    with pytest.raises(MrpSumoError, match="'robot' is at two places at once, 40 times"):
        read_fleet(path).tracks()


def test_vehicle_of_one_pose_is_left_out_and_said(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("t,robot,x,y\n0,ghost,1,1\n" + "\n".join(f"{k},a,{k},0" for k in range(9)))
    log = read_fleet(path)
    assert [track.vehicle for track in log.tracks()] == ["a"]
    assert log.notes == ["ghost has no 4 poses in a row without a gap: left out"]


def rows_on(map_, shift_m):
    begin, end = (map_.nav.xy[each[0]] for each in (map_.nav.tail, map_.nav.head))
    return [(float(k), *(begin + (end - begin) * (k / 20) + shift_m).tolist(), math.nan, math.nan, 0.0) for k in range(21)]


def test_log_of_an_overlapping_site_is_refused_and_one_beside_lanes_is_not():
    map_ = load_map(find_map("office", Path()))
    for shift_m in (0.0, 0.3):
        require_here(here := MotionLog("log", "CSV", poses={"a": rows_on(map_, shift_m)}), map_)
        assert here.notes == []
    with pytest.raises(MrpSumoError, match="from any lane of 'office', expected"):
        require_here(MotionLog("log", "CSV", poses={"a": rows_on(map_, -3.0)}), map_)


@pytest.mark.parametrize(("shift_m", "on_grid", "says"), [(0.0, True, ["keep to the lanes"]), (0.0, False, []), (0.3, True, [])])
def test_vehicles_on_lanes_are_said_to_whom_drives_on_a_grid(shift_m, on_grid, says):
    map_ = load_map(find_map("office", Path()))
    require_here(log := MotionLog("log", "CSV", poses={"a": rows_on(map_, shift_m)}), map_, on_grid=on_grid)
    assert len(log.notes) == len(says) and all(words in note for words, note in zip(says, log.notes))
    mixed = {name: rows_on(map_, shift) for name, shift in (("a", 0.0), ("b", 0.0), ("c", 500.0))}
    with pytest.raises(MrpSumoError, match="log: 100% of the poses of c are more than 10 m from any lane of 'office'"):
        require_here(MotionLog("log", "CSV", poses=mixed), map_)


def test_actions_of_a_csv_last_until_the_first_row_without(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("t_s,x_m,y_m,action,station\n0,0,0,,\n1,0,0,pick,a\n2,0,0,pick,a\n3,0,0,,\n")
    (visit,) = read_fleet(path).visits
    assert (visit.action, visit.station, visit.begin_s, visit.end_s) == ("pick", "a", 1.0, 3.0)


def test_states_alone_with_missing_members_are_read(tmp_path):
    running = [{"actionId": "1", "actionType": "pick", "actionStatus": "RUNNING"}]
    ended = [{"actionId": "1", "actionType": "pick", "actionStatus": "FINISHED"}]
    documents = [state(0), state(1, actionStates=running), state(2, actionStates=running), state(7, actionStates=ended)]
    log = read_fleet(states(tmp_path / "log.jsonl", documents))
    assert [row[1] for row in log.poses["agv"]] == [1.0, 2.0, 3.0, 8.0]
    assert math.isnan(log.poses["agv"][0][4])  # nothing says what was released
    assert [(visit.action, visit.end_s - visit.begin_s) for visit in log.visits] == [("pick", 6.0)]


@pytest.mark.parametrize(
    "came_s, moved_s, said",
    [
        (lambda sent_s: sent_s + 40, 40, ["the clock of agv is 40 s slow, by when its messages came: set right"]),
        (lambda sent_s: sent_s - 2, -2, ["the clock of agv is 2 s fast, by when its messages came: set right"]),
        (lambda sent_s: sent_s + 0.4, 0, []),
        (lambda sent_s: sent_s - 1_767_225_600, 0, []),  # seconds since the recorder began
        (lambda sent_s: None, 0, []),
    ],
)
def test_clock_of_a_vehicle_is_set_by_when_its_messages_came(tmp_path, came_s, moved_s, said):
    begin_s = 1_767_225_600  # 2026
    doing = {
        second: [{"actionId": "1", "actionType": "pick", "actionStatus": status}] for second, status in ((20, "RUNNING"), (25, "FINISHED"))
    }
    payloads = [state(second, actionStates=doing.get(second, []), batteryState={"batteryCharge": 50}) for second in (10, 20, 25)]
    order = {"timestamp": "2026-01-01T00:00:12.100Z", "nodes": [{"nodeId": "n", "actions": [{"actionId": "1"}]}]}
    lines = [
        {"t_s": came_s(begin_s + second), "topic": "uagv/v2/m/agv/state", "payload": each} for second, each in zip((10, 20, 25), payloads)
    ]
    lines.insert(1, {"t_s": begin_s + 12.2, "topic": "uagv/v2/m/agv/order", "payload": order})
    log = read_fleet(states(tmp_path / "log.jsonl", lines))
    visit = log.visits[0]
    assert [row[0] - begin_s for row in log.poses["agv"]] == pytest.approx([10 + moved_s, 20 + moved_s, 25 + moved_s], abs=0.11)
    assert [visit.begin_s - begin_s, visit.end_s - begin_s] == pytest.approx([20 + moved_s, 25 + moved_s], abs=0.11)
    assert [charge.t_s for charge in log.charges] == [row[0] for row in log.poses["agv"]]
    assert log.orders[0].assigned_s - begin_s == pytest.approx(12.1)
    assert log.notes == said


def test_last_line_may_be_cut_off_and_no_other(tmp_path):
    lines = [json.dumps(state(k)) for k in range(5)]
    (path := tmp_path / "log.jsonl").write_text("\n".join(lines)[:-9])
    log = read_fleet(path)
    assert len(log.poses["agv"]) == 4 and log.notes == ["line 5, the last, is cut off: left out"]
    path.write_text("\n".join([*lines[:2], lines[2][:-9], *lines[3:]]))
    with pytest.raises(MrpSumoError, match=r"log\.jsonl:3: not JSON"):
        read_fleet(path)


def test_vehicle_whose_way_is_not_released_waits(tmp_path):
    free, held = [{"released": True}], [{"released": False}]
    log = read_fleet(states(tmp_path / "log.jsonl", [state(0, nodeStates=free), state(1, nodeStates=held), state(2, nodeStates=[])]))
    assert [row[4] for row in log.poses["agv"]] == [0.0, 1.0, 1.0]


def test_vehicle_to_which_nothing_is_ever_released_does_not_say_that_it_waits(tmp_path):
    log = read_fleet(states(tmp_path / "log.jsonl", [state(k, nodeStates=[], actionStates=5) for k in range(3)]))
    assert [math.isnan(row[4]) for row in log.poses["agv"]] == [True] * 3


@pytest.mark.parametrize(
    "text, line",
    [
        ("{", "log.jsonl:1: not JSON"),
        ("[1]\n", "log.jsonl:1: found list, expected a JSON object a line"),
        ('{"agvPosition": {"x": 1, "y": 2}, "timestamp": "today"}\n', "timestamp: found 'today'"),
        ('{"topic": "a/b/c/connection", "payload": {}}\n', "no state says where a vehicle is"),
    ],
)
def test_bad_states_are_one_line(tmp_path, text, line):
    path = tmp_path / "log.jsonl"
    path.write_text(text)
    with pytest.raises(MrpSumoError) as error:
        read_fleet(path)
    assert line in str(error.value)


def test_unknown_kinds_of_files_are_refused(tmp_path):
    (tmp_path / "log.pdf").write_text("")
    with pytest.raises(MrpSumoError, match=r"found '\.pdf'"):
        read_fleet(tmp_path / "log.pdf")
    with pytest.raises(MrpSumoError, match="no such log"):
        read_fleet(tmp_path / "log.csv")


def test_folder_of_logs_is_no_log(tmp_path):
    """With the data of a bag in it, it may be one whose writer was interrupted."""
    (tmp_path / "fleet_1").mkdir()
    with pytest.raises(MrpSumoError, match=r"a folder without a log, expected in it result\.json"):
        read_fleet(tmp_path)
    (tmp_path / "bag_0.mcap").write_bytes(b"")
    with pytest.raises(MrpSumoError, match=r"no metadata\.yaml: not a bag, or its writer was interrupted"):
        read_fleet(tmp_path)
