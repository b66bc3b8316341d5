"""Batteries of a fleet drain by time and motion, and fill at chargers."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import BURGER

from mrp_sumo.core.fleet import fleet_of, fleet_of_types
from mrp_sumo.core.robot_type import Battery, Loaded
from mrp_sumo.drive.batteries import Batteries

SMALL = Battery(10.0, 1.0, 36.0, 1.0, 0.0, 0.0, 36.0)  # 36 kJ: a thousandth a second at rest, one more to accelerate; charged in 100 s


def batteries_of(battery, num_robots, *about, **other):
    return Batteries(fleet_of(replace(BURGER, battery=battery, **other), num_robots), *about)


def test_standing_drains_by_time_and_charging_fills():
    batteries = batteries_of(SMALL, 2, (0.5, 0.5), 0, 0.5)
    for now_s in np.arange(0.0, 10.5, 0.5):
        batteries.add(np.zeros((1, 2)), np.zeros((1, 2)))
        batteries.observe(now_s, np.array([False, True]))
    assert batteries.level == pytest.approx([0.49, 0.6])
    log = batteries.log(10.0, 0.2)
    assert log.used_j == pytest.approx([360, 0]) and log.charged_j == pytest.approx([0, 3600]) and log.t_s.tolist() == [0, 10]


@pytest.mark.parametrize("looks", [(3,), (2, 1), (1, 1, 1)])
def test_speeding_up_and_braking_between_two_looks_draw_both(looks):
    """1 kg to 1 m/s and back in a second: 0.5 J each, beside 36 W."""
    batteries = batteries_of(SMALL, 1, (0.5, 0.5), 0, 0.5)
    speed_mps = np.array([[0.0], [1.0], [0.0]])
    for first, many in zip(np.cumsum((0, *looks)).tolist(), looks):
        batteries.add(np.zeros((many, 1)), speed_mps[first : first + many])
        batteries.observe(first * 0.5, np.array([False]))
    assert batteries.log(1.0, 0.2).used_j == pytest.approx([37.0])


@pytest.mark.parametrize("begin_rad", [0.0, np.pi - 0.1, -np.pi + 0.1])
@pytest.mark.parametrize("by_rad", [0.2, -0.2])
def test_a_turn_draws_as_much_wherever_the_robot_faces(begin_rad, by_rad):
    """1 kg m2 to 0.4 rad/s in half a second and back to rest: 0.8 rad/s2 times 0.4 rad/s, for half a second."""
    turns = Battery(10.0, 1.0, 36.0, 1.0, 1.0, 0.0, 0.0)
    batteries = batteries_of(turns, 1, (0.5, 0.5), 0, 0.5)
    yaw_rad = (begin_rad + np.array([[0.0], [by_rad], [by_rad]]) + np.pi) % (2 * np.pi) - np.pi
    batteries.add(yaw_rad, np.zeros((3, 1)))
    batteries.observe(1.0, np.array([False]))
    assert batteries.log(1.0, 0.2).used_j == pytest.approx([0.16])


@pytest.mark.parametrize("calls", [[[1], [3], [6]], [[1, 3], [6]], [[1], [3, 6]], [[1, 3, 6]]])
def test_turns_and_speeds_draw_as_much_however_looks_are_put_together(calls):
    """Five intervals of 0.5 s: 1 kg to 0.5 m/s and on to 1 m/s, and 1 kg m2 to 0.4 rad/s, to 0.8 rad/s, and back to rest."""
    batteries = batteries_of(Battery(10.0, 1.0, 36.0, 1.0, 1.0, 0.0, 0.0), 1, (0.5, 0.5), 0, 0.5)
    speed_mps, yaw_rad = np.array([0, 0.5, 1, 1, 1, 1.0])[:, None], np.array([0, 0, 0, 0.2, 0.6, 0.6])[:, None]
    seen = 0
    for looks in calls:
        batteries.add(yaw_rad[seen : looks[-1]], speed_mps[seen : looks[-1]])
        batteries.observe_each([0.5 * (k - 1) for k in looks], [k - seen + (seen > 0) for k in looks], np.zeros(1, np.bool_))
        seen = looks[-1]
    turns_j = (0.8 * 0.4 + 0.8 * 0.8) * 0.5
    assert batteries.log(2.5, 0.2).used_j == pytest.approx([0.5 + turns_j])


def test_two_looks_at_once_charge_for_as_long_as_lies_between_them():
    """1 s and 2 s at a charger that fills the battery of 36 kJ in 100 s."""
    batteries = batteries_of(SMALL, 1, (0.5, 0.5), 0, 0.5)
    batteries.add(np.zeros((7, 1)), np.zeros((7, 1)))
    batteries.observe_each([1.0, 3.0], [3, 7], np.array([True]))
    assert batteries.level == pytest.approx([0.53]) and batteries.log(3.0, 0.2).charged_j == pytest.approx([0.03 * 36_000])


def test_each_lift_draws_its_energy_once():
    """Two lifts until the first look, three until the second."""
    lifting = replace(SMALL, device_w=0.0, lift_j=90.0)
    batteries, used_j = batteries_of(lifting, 1, (0.5, 0.5), 0, 0.5), []
    for now_s, num_lifts in ((0.5, 2), (1.0, 3)):
        batteries.add(np.zeros((2, 1)), np.zeros((2, 1)))
        batteries.observe(now_s, np.array([False]), None, np.array([num_lifts]))
        used_j.append(float(batteries.log(now_s, 0.2).used_j[0]))
    assert used_j == pytest.approx([180.0, 270.0])


@pytest.mark.parametrize(("level", "output"), [(0.0008, [[0], []]), (0.0018, [[], [0]]), (0.5, [[], []])])
def test_who_runs_empty_is_told_once(level, output):
    """A thousandth a second, looked at after each."""
    batteries, seen = batteries_of(SMALL, 1, (level, level), 0, 0.5), []
    for now_s in (1.0, 2.0):
        batteries.add(np.zeros((3 if now_s == 1.0 else 2, 1)), np.zeros((3 if now_s == 1.0 else 2, 1)))
        seen.append(batteries.observe(now_s, np.array([False])))
    assert seen == output


@pytest.mark.parametrize(("num_looks", "emptied"), [(1, []), (2, [0]), (3, [])])
def test_a_battery_that_runs_empty_gives_what_it_has_and_is_named_in_that_look_alone(num_looks, emptied):
    """64.8 J are left of the first, at 36 J a look; the other has plenty."""
    batteries = batteries_of(SMALL, 2, (0.5, 0.5), 0, 0.5)
    batteries.level = np.array([0.0018, 0.5])
    batteries.add(np.zeros((1 + 2 * num_looks, 2)), np.zeros((1 + 2 * num_looks, 2)))
    looks = range(1, num_looks + 1)
    assert batteries.observe_each([float(k) for k in looks], [1 + 2 * k for k in looks], np.zeros(2, np.bool_)) == emptied
    assert batteries.level == pytest.approx([max(0.0018 - 0.001 * num_looks, 0.0), 0.5 - 0.001 * num_looks])
    assert batteries.log(3.0, 0.2).used_j == pytest.approx([min(64.8, 36.0 * num_looks), 36.0 * num_looks])


def test_what_draws_nothing_does_not_run_empty():
    batteries = batteries_of(replace(SMALL, device_w=0.0), 2, (0.0, 0.0), 0, 0.5)
    batteries.level = np.array([0.0, 1e-7])
    batteries.add(np.zeros((3, 2)), np.zeros((3, 2)))
    assert batteries.observe(1.0, np.zeros(2, np.bool_)) == []
    assert batteries.log(1.0, 0.2).level.tolist() == [[0.0, 1e-6]]  # rounded up: it is not empty


def test_a_charger_fills_no_more_than_the_battery_holds_and_spares_it():
    """2 s at 360 W, of which one fits; the other draws 36 W meanwhile."""
    batteries = batteries_of(SMALL, 2, (0.99, 0.99), 0, 0.5)
    batteries.add(np.zeros((5, 2)), np.zeros((5, 2)))
    batteries.observe_each([1.0, 2.0], [3, 5], np.array([True, False]))
    log = batteries.log(2.0, 0.2)
    assert batteries.level == pytest.approx([1.0, 0.988])
    assert log.charged_j == pytest.approx([360.0, 0.0]) and log.used_j == pytest.approx([0.0, 72.0])


def test_levels_are_kept_every_ten_seconds_and_at_the_end():
    batteries = batteries_of(SMALL, 1, (0.5, 0.5), 0, 0.5)
    batteries.add(np.zeros((1, 1)), np.zeros((1, 1)))
    batteries.observe_each([0.0, 5.0, 10.0 - 1e-10, 15.0, 24.5, 29.5], [1] * 6, np.array([False]))
    assert batteries.log(24.5, 0.2).t_s.tolist() == [0.0, 10.0 - 1e-10, 24.5]
    assert batteries.log(29.5, 0.2).t_s.tolist() == [0.0, 10.0 - 1e-10, 24.5, 29.5]


def test_the_levels_at_first_belong_to_the_seed():
    level = batteries_of(SMALL, 3, (0.2, 0.6), 7, 0.5).level
    assert level.tolist() == np.random.default_rng([7, 43]).uniform(0.2, 0.6, 3).tolist()


def test_each_type_draws_from_its_own_battery():
    """36 W of 36 kJ, and of twice as much, for a second."""
    types = [replace(BURGER, battery=battery) for battery in (SMALL, replace(SMALL, capacity_ah=2.0))]
    batteries = Batteries(fleet_of_types(types, np.array([0, 1, 0])), (0.5, 0.5), 0, 0.5)
    batteries.add(np.zeros((3, 3)), np.zeros((3, 3)))
    batteries.observe(1.0, np.zeros(3, np.bool_))
    assert batteries.level == pytest.approx([0.499, 0.4995, 0.499])


@pytest.mark.parametrize(("charging_a", "most_per_s"), [(36.0, 0.01), (1.8, 0.001 * (36.0 + 0.5 * 2.5) / 36.0)])
def test_most_that_a_level_changes_is_by_charging_or_by_speeding_up(charging_a, most_per_s):
    """Full in 100 s, or in 2000 s; 1 kg that gains 2.5 m/s2 at 0.5 m/s takes 1.25 W, beside 36 W of 36 kJ."""
    fast = replace(BURGER, max_speed_mps=0.5, accel_mps2=2.5, decel_mps2=2.0, battery=replace(SMALL, charging_a=charging_a))
    assert Batteries(fleet_of(fast, 1), (0.5, 0.5), 0, 0.5).most_per_s() == pytest.approx([most_per_s])


def test_a_load_is_sped_up_and_braked_too():
    """1 kg without a load and 3 kg with one, to 1 m/s and back in a second: 1 J or 3 J, beside 36 J."""
    batteries = batteries_of(SMALL, 2, (0.5, 0.5), 0, 0.5, loaded=Loaded(mass_kg=3.0))
    batteries.add(np.zeros((3, 2)), np.array([[0.0], [1.0], [0.0]]).repeat(2, 1))
    batteries.observe(1.0, np.zeros(2, np.bool_), np.array([False, True]))
    assert batteries.log(1.0, 0.2).used_j == pytest.approx([37.0, 39.0])


@pytest.mark.parametrize(("loaded", "more_w"), [(None, 0.0), (Loaded(mass_kg=3.0), 2 * 0.5 * 2.5)])
def test_most_that_a_level_changes_is_with_a_load_and_in_a_turn(loaded, more_w):
    """1 kg m2 from 0.5 rad/s one way to the other in half a second takes 1 W; 1 kg that gains 2.5 m/s2 at 0.5 m/s takes 1.25 W."""
    limits = {"max_speed_mps": 0.5, "accel_mps2": 2.5, "decel_mps2": 2.0, "turn_rate_rad_s": 0.5, "loaded": loaded}
    slow = replace(SMALL, charging_a=0.1, inertia_kgm2=1.0)
    batteries = batteries_of(slow, 1, (0.5, 0.5), 0, 0.5, **limits)
    assert batteries.most_per_s() == pytest.approx([(36.0 + 1.25 + 1.0 + more_w) / 36_000])
