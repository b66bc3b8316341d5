"""Shifts at stations, by hand: when services may begin."""

from itertools import islice

import numpy as np
import pytest
from floors import BATTERY, driven, ring, scenario

from mrp_sumo.core.battery import Charging
from mrp_sumo.core.shifts import Shift, opens_s
from mrp_sumo.errors import OptionError, ScenarioError
from mrp_sumo.experiments.audit_work import logs_of
from mrp_sumo.metrics.operations import places

HOUR_S = 3600.0
DAY = Shift(begin_h=6, end_h=14, breaks_h=((9, 9.5), (9.5, 10)))
NIGHT = Shift(begin_h=22, end_h=30)


@pytest.mark.parametrize(
    ("shifts", "t_h", "opens_h"),
    [
        ([], 3, 3),
        ([DAY], 3, 6),
        ([DAY], 6, 6),
        ([DAY], 8.999, 8.999),
        ([DAY], 9, 10),
        ([DAY], 13.999, 13.999),
        ([DAY], 14, 30),
        ([NIGHT], 1, 1),
        ([NIGHT], 6, 22),
        ([NIGHT], 29, 29),
        ([DAY, NIGHT], 15, 22),
        ([DAY, NIGHT], 24 * 7 + 9.2, 24 * 7 + 10),
    ],
)
def test_services_begin_in_shifts_and_out_of_breaks(shifts, t_h, opens_h):
    spans = tuple(span for shift in shifts for span in shift.spans_s)
    assert opens_s(spans, t_h * HOUR_S) == pytest.approx(opens_h * HOUR_S)


@pytest.mark.parametrize(
    ("figures", "says"),
    [
        ({"begin_h": 6, "end_h": 6}, "is empty"),
        ({"begin_h": 8, "end_h": 6}, "is empty"),
        ({"begin_h": 6, "end_h": 31}, "longer than a day"),
        ({"begin_h": 25, "end_h": 30}, "begin_h is 25"),
        ({"begin_h": 6, "end_h": 14, "breaks_h": ((5, 7),)}, "break from 5 to 7"),
        ({"begin_h": 6, "end_h": 14, "breaks_h": ((8, 8),)}, "break from 8 to 8"),
        ({"begin_h": 6, "end_h": 14, "breaks_h": ((9, 10), (8, 9))}, "ascending"),
        ({"begin_h": 6, "end_h": 14, "breaks_h": ((6, 14),)}, "all breaks"),
    ],
)
def test_shifts_in_which_nobody_works_are_refused(figures, says):
    with pytest.raises(OptionError, match=says):
        Shift(**figures)


def order(shifts, **more):
    """A stop of 20 s at A, to which a robot comes after some seconds."""
    station = {"places": ["A"], "shifts": shifts, **more}
    return {"stations": {"work": station}, "list": [{"name": "o", "stops": ["work", "B"], "service_s": [20.0, 0.0]}]}


@pytest.mark.parametrize(
    ("shifts", "begin_s"),
    [
        ([{"begin_h": 0, "end_h": 1}], None),
        ([{"begin_h": 0.05, "end_h": 1}], 180.0),
        ([{"begin_h": 0, "end_h": 1, "breaks_h": [[0.001, 0.03]]}], 108.0),
        ([{"begin_h": 0, "end_h": 0.006}], None),
    ],
    ids=["open", "not yet", "a break", "under way at the end"],
)
def test_a_service_begins_in_a_shift_and_ends_also_after_it(tmp_path, shifts, begin_s):
    """The robot comes at some 11 s. A shift that ends at 21.6 s, while it is served, does not end the service."""
    result = driven(scenario(ring(tmp_path), order(shifts), starts=["c1"]))
    stops = result.execution.stops
    assert result.status == "completed" and not result.operations_audit["findings"], result.note
    assert stops.begin_s[0] == pytest.approx(begin_s) if begin_s else 2.0 < stops.begin_s[0] < 15.0
    assert stops.end_s[0] - stops.begin_s[0] == pytest.approx(20.0)
    assert result.execution.tasks.opened_s[0] == stops.begin_s[0]


def test_the_audit_finds_a_service_out_of_its_shift(tmp_path):
    result = driven(scenario(ring(tmp_path), order([{"begin_h": 0.05, "end_h": 1}]), starts=["c1"]))
    logs = logs_of(result)
    assert not list(places.shifts(logs))
    logs.stops.begin_s.flags.writeable = True
    logs.stops.begin_s[0] = 179.0
    (finding,) = places.shifts(logs)
    assert "begins at 179.00 s" in finding.text and finding.place == "work"


def test_a_robot_that_waits_for_a_shift_to_the_end_has_begun_nothing(tmp_path):
    """Nor is it stalled: the shift would begin at 252 s, and the run ends at 300 s, after a breakdown until 270 s and on."""
    broken = {"breakdowns": [{"robot": 0, "begin_s": 100.0, "duration_s": 100.0}]}
    shifts = [{"begin_h": 0.02, "end_h": 0.021}, {"begin_h": 0.07, "end_h": 1}]
    result = driven(scenario(ring(tmp_path), order(shifts), starts=["B"], execution={"time_limit_s": 200.0, "disturbances": broken}))
    run = result.execution
    assert not len(run.stops.task) or run.stops.begin_s[0] < 200.0
    assert not any(event.kind == "stalled" for event in run.events) and not result.operations_audit["findings"], result.note


def test_who_breaks_down_before_its_shift_is_served_when_it_is_mended(tmp_path):
    broken = {"breakdowns": [{"robot": 0, "begin_s": 100.0, "duration_s": 150.0}]}
    result = driven(scenario(ring(tmp_path), order([{"begin_h": 0.05, "end_h": 1}]), starts=["c1"], execution={"disturbances": broken}))
    stops = result.execution.stops
    assert stops.begin_s[0] == pytest.approx(250.0, abs=0.6) and stops.end_s[0] - stops.begin_s[0] == pytest.approx(20.0)
    assert not result.operations_audit["findings"], result.note


def test_a_shift_that_never_begins_is_refused(tmp_path):
    with pytest.raises(ScenarioError, match=r"shifts: the first begins at 6 h, but the run ends at 0\.0833333 h"):
        driven(scenario(ring(tmp_path), order([{"begin_h": 6, "end_h": 14}]), starts=["c1"]))


@pytest.mark.parametrize("charges", [True, False])
def test_robots_charge_while_they_are_served_where_the_station_does_so(tmp_path, charges):
    """For 20 s; elsewhere nothing is charged, and the audit of batteries holds for both."""
    file = scenario(ring(tmp_path), order([], charges=charges), starts=["c1"], shape={"battery": BATTERY})
    result = driven(file)
    assert not result.operations_audit["findings"], result.note
    assert bool(result.execution.batteries.charged_j[0] > 0) == charges


def test_a_swapped_battery_is_full_after_the_time_of_a_swap(tmp_path):
    """12 s at the charger from 50 %, of which charging would take 30 s."""
    charging = {
        "stations": ["c3"],
        "critical_low_charging_level": 60,
        "minimum_desired_charging_level": 70,
        "start_level": [50, 50],
        "swap_s": 12.0,
    }
    tasks = {"charging": charging, "list": [{"name": "o", "stops": ["A"], "release_s": 100.0, "service_s": 1.0}]}
    result = driven(scenario(ring(tmp_path), tasks, starts=["c2"], shape={"battery": BATTERY}))
    run = result.execution
    row = int(np.flatnonzero(~run.tasks.is_order[run.stops.task])[0])
    assert run.stops.end_s[row] - run.stops.begin_s[row] == pytest.approx(12.0)
    assert run.batteries.level[np.searchsorted(run.batteries.t_s, run.stops.end_s[row] - 0.6) + 1, 0] > 0.97
    assert not result.operations_audit["findings"], result.note


def test_swapping_for_less_than_a_full_battery_is_refused():
    with pytest.raises(OptionError, match="maximum_desired_charging_level is 80 with swap_s, expected 100"):
        Charging(stations=("c",), maximum_desired_charging_level=80.0, swap_s=60.0)


def test_a_profile_of_all_streams_multiplies_their_rates(tmp_path):
    """600 orders an hour for a quarter of the time, then none: 3,600 in the first quarter of a day; with its own profile, none then."""
    streams = [
        {"name": name, "stops": ["A"], "arrivals": {"rate_per_h": 600, **own}} for name, own in (("a", {}), ("b", {"profile": [0, 1]}))
    ]
    file = scenario(ring(tmp_path), {"streams": streams, "profile": [1, 0, 0, 0]}, starts=["c1"], execution={"time_limit_s": 5.0})
    a, b = logs_of(driven(file)).terms.sources
    times = [task.release_s for task in islice(a.tasks(), 5000)]
    first_day = sum(t_s < 86_400 for t_s in times)
    assert all(t_s % 86_400 < 21_600 for t_s in times) and abs(first_day - 3600) < 4 * 60
    assert next(iter(b.tasks())).release_s >= 43_200


def test_a_profile_without_a_rate_is_refused(tmp_path):
    streams = [{"name": "a", "stops": ["A"], "arrivals": {"open": 2}}]
    with pytest.raises(ScenarioError, match="profile goes with a stream with rate_per_h"):
        scenario(ring(tmp_path), {"streams": streams, "profile": [1, 2]}, starts=["c1"])


@pytest.mark.parametrize(
    ("shifts", "begin_s"), [([], None), ([{"begin_h": 0.02, "end_h": 0.03}], 72.0), ([{"begin_h": 0, "end_h": 1}], None)]
)
@pytest.mark.parametrize("policy", ["threshold", "opportunity"])
def test_charging_begins_in_a_shift_and_fills_from_then_on(tmp_path, shifts, begin_s, policy):
    """It has to charge at once; `opportunity` sends nobody else before, nor calls it off."""
    levels = {"critical_low_charging_level": 60, "minimum_desired_charging_level": 70, "maximum_desired_charging_level": 90}
    charging = {"stations": ["B"], "start_level": [50, 50], "policy": policy, "shifts": shifts, **levels}
    tasks = {"charging": charging, "list": [{"name": "o", "stops": ["A"], "release_s": 250.0, "service_s": 1.0}]}
    result = driven(scenario(ring(tmp_path), tasks, starts=["c1"], shape={"battery": BATTERY}))
    run = result.execution
    assert not result.operations_audit["findings"], result.note
    began_s = float(run.stops.begin_s[int(np.flatnonzero(~run.tasks.is_order[run.stops.task])[0])])
    assert began_s == begin_s if begin_s else began_s < 60.0
    level, t_s = run.batteries.level[:, 0], run.batteries.t_s
    assert level[t_s <= began_s].max() <= 0.5 < level.max()


def test_a_shift_of_chargers_that_never_begins_is_refused(tmp_path):
    tasks = {"charging": {"stations": ["B"], "shifts": [{"begin_h": 6, "end_h": 14}]}, "list": [{"name": "o", "stops": ["A"]}]}
    with pytest.raises(ScenarioError, match=r"tasks.charging.shifts: the first begins at 6 h, but the run ends at 0\.0833333 h"):
        driven(scenario(ring(tmp_path), tasks, starts=["c1"], shape={"battery": BATTERY}))
