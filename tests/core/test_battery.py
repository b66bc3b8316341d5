"""Batteries drain and fill as Open-RMF's figures say."""

from contextlib import nullcontext

import numpy as np
import pytest

from mrp_sumo.core.battery import Charging, full_s, start_shares
from mrp_sumo.core.robot_type import Battery
from mrp_sumo.errors import OptionError

TINY = {
    "voltage_v": 12.0,
    "capacity_ah": 24.0,
    "charging_a": 5.0,
    "mass_kg": 20.0,
    "inertia_kgm2": 10.0,
    "friction": 0.22,
    "device_w": 20.0,
}


def test_a_robot_at_a_steady_speed_draws_what_friction_and_devices_take():
    battery, still = Battery(**TINY), np.zeros(1)
    (power_w,) = battery.power_w(np.array([0.5]), still, still, still)
    assert power_w == pytest.approx(41.6, abs=0.05)
    assert battery.energy_j / power_w / 3600 == pytest.approx(6.9, abs=0.05)
    assert battery.charge_s(1.0) / 3600 == pytest.approx(4.8)


def test_braking_and_turning_cost_too():
    battery, still, one = Battery(**TINY), np.zeros(1), np.ones(1)
    assert battery.power_w(one, -one, still, still) == battery.power_w(one, one, still, still)
    assert battery.power_w(still, still, one, -one)[0] == pytest.approx(20 + 10)


def test_what_no_battery_has_is_refused():
    with pytest.raises(OptionError, match="capacity_ah is 0, expected at least 1e-05"):
        Battery(**TINY | {"capacity_ah": 0.0})


@pytest.mark.parametrize(
    ("levels", "policy", "says"),
    [
        ((30.0, 20.0, 90.0), "threshold", "in ascending order"),
        ((30.0, 95.0, 90.0), "threshold", "in ascending order"),
        ((90.0, 90.0, 90.0), "threshold", "in ascending order"),
        ((30.0, 30.0, 90.0), "threshold", ""),
        ((30.0, 90.0, 90.0), "opportunity", ""),
        ((30.0, 30.0, 90.0), "opportunity", "a minimum_desired above critical_low"),
    ],
)
def test_levels_that_do_not_ascend_are_refused(levels, policy, says):
    critical, minimum, maximum = levels
    with pytest.raises(OptionError, match=says) if says else nullcontext():
        charging = Charging(
            stations=("dock",),
            policy=policy,
            critical_low_charging_level=critical,
            minimum_desired_charging_level=minimum,
            maximum_desired_charging_level=maximum,
        )
        assert (charging.critical, charging.minimum, charging.maximum) == (critical / 100, minimum / 100, maximum / 100)
        assert charging.opportunity == (policy == "opportunity")


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"swap_s": 60.0, "maximum_desired_charging_level": 99.5}, "maximum_desired_charging_level is 99.5 with swap_s, expected 100"),
        ({"maximum_desired_charging_level": 90.0}, ""),
        ({"start_level": (50.0, 50.0)}, ""),
        ({"maximum_desired_charging_level": 100.5}, "maximum_desired_charging_level is 100.5"),
        ({"start_level": (60.0, 50.0)}, "start_level is"),
        ({"swap_s": 60.0}, ""),
        ({"swap_s": 1e6}, ""),
        ({"swap_s": 1e6 + 1}, "swap_s is 1e\\+06, expected above 0 and at most 1e\\+06"),
        ({"swap_s": 0.0}, "swap_s is 0, expected above 0"),
        ({"minimum_charging_time_s": 0.0, "critical_low_charging_level": 0.0, "start_charging": 100.0}, ""),
        ({"critical_low_charging_level": -0.1}, "expected at least 0 and at most 100"),
        ({"start_charging": 100.1}, "expected at least 0 and at most 100"),
    ],
)
def test_levels_that_no_battery_reaches_are_refused(keys, says):
    with pytest.raises(OptionError, match=says) if says else nullcontext():
        Charging(stations=("dock",), **keys)


def test_a_swap_takes_its_own_time():
    """Instead of the 400 s that a charger would need."""
    chargers = None, Charging(stations=("A",)), Charging(stations=("A",), swap_s=60.0)
    assert [full_s(charging, 400.0) for charging in chargers] == [400.0, 400.0, 60.0]


def test_who_stands_draws_idle_power_instead():
    battery = Battery(**TINY | {"device_w": 20.0, "idle_w": 5.0})
    speed, rate, still = np.array([0.0, 0.5, 0.0]), np.array([0.0, 0.0, 0.3]), np.zeros(3)
    driven_w = battery.mass_kg * battery.friction * 9.81 * 0.5
    assert battery.power_w(speed, still, rate, still) == pytest.approx([5.0, 20.0 + driven_w, 20.0])
    assert Battery(**TINY | {"device_w": 20.0}).power_w(speed[:1], still[:1], rate[:1], still[:1]) == pytest.approx([20.0])


def test_robots_begin_full_where_nothing_is_said():
    assert start_shares(None) == start_shares(Charging(stations=("A",))) == (1.0, 1.0)
    assert start_shares(Charging(stations=("A",), start_level=(30.0, 60.0))) == (0.3, 0.6)
