import math
from types import SimpleNamespace

import numpy as np
import pytest

from mrp_sumo.calibration import held_out
from mrp_sumo.calibration.estimates import CalibratedFigure, Calibration
from mrp_sumo.calibration.files import disturbances_of
from mrp_sumo.calibration.held_out import HeldOut, ServiceTimes, _natural, _seen, action_of, cut, more_of, starts_at, tasks_of
from mrp_sumo.calibration.log import ActionTime, LoggedOrder, MotionLog
from mrp_sumo.calibration.prediction import _together
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.staging.set_up import set_up
from mrp_sumo.io.scenario.read import read_scenario


def poses(shift_s=0.0, at_m=0.0, seconds=600):
    return [(t + shift_s, math.sin(t / 50) * 10 + at_m, 0.0, 0.0, math.nan, 0.0) for t in range(seconds)]


def order(name, release_s, *services, stops=("shelf", "dock"), **asks):
    done_s = services[-1][1] if len(services) == len(stops) else math.nan
    return LoggedOrder(name, stops, release_s, release_s + 1, "a" if services else "", tuple(services), done_s, done_s, asks)


def held(*orders, cut_s=300.0):
    return HeldOut(MotionLog("log", "CSV"), 0.0, cut_s, 600.0, ("a", "b"), np.zeros(2, int), np.zeros((2, 2)), np.zeros(2, int), orders)


TIMES = ServiceTimes([ActionTime("a", kind, "", 0.0, 10.0) for kind in ("pick", "drop")], {})


def test_order_on_board_goes_on_with_its_vehicle_from_the_stop_that_comes_next():
    carried = order("carried", 200, (250.0, 260.0), (330.0, 340.0))
    served = order("served", 200, (294.0, 304.0), (330.0, 340.0))
    waiting = order("waiting", 200, due_s=500)
    new = order("new", 350, (400.0, 410.0), (420.0, 430.0))
    made = {task["name"]: task for task in tasks_of(held(carried, served, waiting, new), TIMES, 0)}
    assert (made["carried"]["stops"], made["carried"]["robot"], made["carried"]["service_s"]) == (["dock"], "robot_0", [10.0])
    assert made["served"]["stops"] == ["shelf", "dock"]
    assert made["served"]["service_s"] == [4.0, 10.0]  # six of ten seconds were over
    assert (made["waiting"]["release_s"], made["waiting"]["due_s"]) == (0.0, 200)
    assert "robot" not in made["waiting"]
    assert (made["new"]["release_s"], made["new"]["service_s"]) == (50.0, [10.0, 10.0])  # its own times are of the future


def test_simulation_that_always_has_orders_open_does_not_run_out_of_them():
    tasks = tasks_of(held(*(order(f"o{k}", 310 + k) for k in range(6)), order("old", 100)), TIMES, 0)
    more = more_of(tasks, 300.0)
    assert [(task["name"], task["release_s"], task["stops"]) for task in more] == [
        (f"o{k} again", 300.0, ["shelf", "dock"]) for k in range(3)
    ]


def test_service_times_are_those_of_the_station_where_it_has_enough():
    visits = [ActionTime("a", "pick", "fast", 0.0, 5.0)] * 8 + [ActionTime("a", "pick", "slow", 0.0, 50.0)]
    times, rng = ServiceTimes(visits, {}), np.random.default_rng(0)
    assert {times.drawn_s("fast", "pick", rng) for _ in range(20)} == {5.0}
    assert {times.drawn_s("slow", "pick", rng) for _ in range(60)} == {5.0, 50.0}


def test_other_service_times_are_as_many_of_the_same_drawn_again():
    """Each of 9 is left out of such a draw with (8 / 9)^9, 35 %."""
    visits = [ActionTime("a", "pick", "A", 0.0, float(k)) for k in range(1, 10)]
    times, rng = ServiceTimes(visits, {}), np.random.default_rng(0)
    one = times.another(rng)
    mine = {one.drawn_s("A", "pick", rng) for _ in range(300)}
    assert mine < {times.drawn_s("A", "pick", rng) for _ in range(300)} == set(map(float, range(1, 10)))


@pytest.mark.parametrize(
    "named, line",
    [
        ({"a": poses(), "b": poses(at_m=0.01)}, "'a' and 'b' are at the same places all the time: one vehicle of two names"),
        ({"a": poses(), "b": poses(shift_s=0.4)}, "'a' and 'b' are at the same places all the time: one vehicle of two names"),
        ({"a": poses() + poses(shift_s=100), "b": poses(at_m=30)}, "the clock of 'a' jumps back by 8 min at 599 s"),
        ({"a": poses(seconds=60)}, "59 s in all, too short to tell anything"),
        (
            {
                "a": poses(),
                "b": poses(at_m=30),
                "c": poses(shift_s=7200, at_m=60),
                "d": poses(shift_s=-3600, at_m=90),
                "e": poses(at_m=120),
            },
            "the clock of 'c' is 2 h off",
        ),
        ({"a": poses(), "b": poses(at_m=30), "c": poses(shift_s=-7200, at_m=60)}, "the clock of 'c' is 2 h off"),
    ],
)
def test_log_that_cannot_be_compared_is_refused(named, line):
    with pytest.raises(MrpSumoError) as error:
        cut(MotionLog("log", "CSV", poses=named), SimpleNamespace(file=None, map=None), 0.5)
    assert line in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("vehicle", "says"), [("a", []), ("gone", ["orders of gone, of which there are no poses at the cut, are left out"])]
)
def test_orders_of_a_vehicle_that_is_not_there_are_left_out(monkeypatch, vehicle, says):
    named = {"a": poses(), "b": poses(at_m=30)}
    monkeypatch.setattr(held_out, "levels_on", lambda *_: {0.0: 0})
    monkeypatch.setattr(held_out, "shift_on", lambda *_: np.zeros((1, 2)))
    monkeypatch.setattr(held_out, "_kinds", lambda log, file, vehicles: dict.fromkeys(vehicles, 0))
    orders = [LoggedOrder("kept", ("dock",), 400.0), LoggedOrder("its", ("dock",), 400.0, vehicle=vehicle)]
    made = cut(MotionLog("log", "CSV", poses=named, orders=orders), SimpleNamespace(file=None, map=None), 0.5)
    assert [each.name for each in made.orders] == ["kept", "its"][: 2 - len(says)]
    assert made.notes == says


def test_vehicle_that_is_gone_for_a_part_is_seen_for_less_of_it():
    t = np.arange(600.0)
    assert _seen(t, 300.0, 599.0) == 1.0
    assert _seen(t[t < 330], 300.0, 600.0) == pytest.approx((330 + 120 - 300) / 300, abs=0.02)
    assert _seen(np.concatenate((t[t < 301], t[t < 301] + 5000)), 300.0, 700.0) == pytest.approx(0.3, abs=0.02)


def test_disturbances_of_two_types_count_by_what_they_are_from():
    def one(noise, count, rate, span_s):
        figures = {"speed_noise": CalibratedFigure("speed_noise", "", noise, 0.5 * noise, 2 * noise, count, "steps")}
        figures["stops_per_s"] = CalibratedFigure("stops_per_s", "1/s", rate, 0.0, 2 * rate, 0, "stops")
        return Calibration(MotionLog("log", "CSV"), [], span_s, figures)

    both = [one(0.04, 300, 0.001, 1000.0), one(0.08, 100, 0.005, 3000.0)]
    figures = _together([disturbances_of(each) for each in both], both)
    assert figures["speed_noise"] == pytest.approx(0.05)
    assert figures["intervals"]["speed_noise"] == pytest.approx([0.025, 0.1])
    assert figures["stops_per_s"] == pytest.approx(0.004)
    assert figures["stop_median_s"] == 6.0


def test_what_is_left_of_a_service_is_drawn_from_those_that_took_longer():
    visits = [ActionTime("a", "pick", "s", 0.0, lasted_s) for lasted_s in (5.0, 10.0, 20.0)] + [
        ActionTime("a", "startCharging", "s", 0.0, 99.0)
    ]
    times, rng = ServiceTimes(visits, {"s": "shelf"}), np.random.default_rng(0)
    assert {times.drawn_s("shelf", "pick", rng, 10.0) for _ in range(20)} == {10.0}
    assert {times.drawn_s("shelf", "drop", rng, 4.0) for _ in range(60)} == {1.0, 6.0, 16.0}  # of any action
    assert times.drawn_s("shelf", "pick", rng, 20.0) == 0.0
    assert times.is_known and not ServiceTimes(visits[-1:], {}).is_known


def test_actions_are_named_by_their_place_in_the_order():
    assert [action_of(n, 3) for n in range(3)] == ["pick", "service", "drop"] and action_of(0, 1) == "pick"
    assert sorted(["robot_10", "robot_9", "a1b"], key=_natural) == ["a1b", "robot_9", "robot_10"]


def test_a_log_is_cut_at_a_share_of_its_time_and_keeps_who_is_there_and_what_is_open():
    """Of 0 to 599 s, of which 40 % are held out: 359.4 s."""
    named = {"b": poses(at_m=30), "a": poses(), "gone": poses(at_m=60, seconds=239)}
    orders = [order("early", 10, (20.0, 30.0), (40.0, 50.0)), order("open", 10), order("new", 400), order("after", 600)]
    log = MotionLog("log", "CSV", poses=named)
    log.orders = orders
    site = SimpleNamespace(xy=np.zeros((1, 2)), level_names=("L1",))
    setup = SimpleNamespace(file=SimpleNamespace(), map=SimpleNamespace(nav=site, building=None, level_shift_m={}))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(held_out, "robot_types", lambda file: [None])
        patch.setattr(held_out, "levels_on", lambda log, map_: {})
        patch.setattr(held_out, "shift_on", lambda log, map_: np.array([[100.0, 0.0]]))
        held = cut(log, setup, 0.4)
    assert (held.begin_s, held.cut_s, held.end_s, held.span_s) == pytest.approx((0.0, 359.4, 599.0, 239.6))
    assert held.vehicles == ("a", "b") and [each.name for each in held.orders] == ["open", "new"]
    assert held.xy == pytest.approx(np.array([(math.sin(359 / 50) * 10 + 100 + at_m, 0.0) for at_m in (0, 30)]))
    assert held.notes == ["left out, since nobody knows where they are at the cut: gone"]
    assert {name: len(rows) for name, rows in held.earlier().poses.items()} == {"a": 360, "b": 360, "gone": 239}
    assert {name: len(rows) for name, rows in held.later().poses.items()} == {"a": 240, "b": 240}


@pytest.mark.parametrize(("options", "starts"), [("{name: b, mutex: m}", ["a", "c"]), ("{name: b}", ["a", "b"])])
def test_no_two_vehicles_start_in_a_mutex_group(options, starts, tmp_path):
    """Vertices a to d are 2 m apart; two vehicles are at a and b when the log is cut."""
    vertices = f"[[0, 0, {{name: a, mutex: m}}], [2, 0, {options}], [4, 0, {{name: c}}], [6, 0, {{name: d}}]]"
    lanes = [[*ends, {}] for k in range(3) for ends in ((k, k + 1), (k + 1, k))]
    (tmp_path / "row.nav.yaml").write_text(f"building_name: row\nlevels: {{L1: {{vertices: {vertices}, lanes: {lanes}}}}}\n")
    (tmp_path / "s.yaml").write_text("map: ./row.nav.yaml\nrobots: 2\ndiscretisation: {kind: roadmap, cell_m: 2.0}\n")
    here = {"xy": np.array([[0.0, 0.0], [2.1, 0.0]]), "level": np.zeros(2, np.int64), "kind": np.zeros(2, np.int64)}
    with MapCache() as maps:
        setup = set_up(read_scenario(tmp_path / "s.yaml"), maps)
        assert starts_at(SimpleNamespace(vehicles=("x", "y"), log=SimpleNamespace(source="log"), **here), setup) == starts
