"""The audit finds robots that are faster than their fields allow, and tells whose doing a contact is."""

from dataclasses import replace

import numpy as np
import pytest
from vehicles import TUGGER
from worlds import CART, record_of_four

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.people import PeopleLog
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.io.people_table import read_people, write_people
from mrp_sumo.metrics.audit import audit, in_words

FIELDS = {"radius_m": 0.25, "extra_m": 0.45, "reaction_s": 0.2, "side_m": 0.1, "slowest_mps": 0.1}


def sightings(x, y, **fields):
    """One person who is at x, y [T]; NaN: not there."""
    there = np.isfinite(x)
    none = np.zeros(0)
    return PeopleLog(
        first=np.concatenate([[0], np.cumsum(there)]),
        person=np.zeros(there.sum(), np.int32),
        x_m=x[there].astype(np.float32),
        y_m=y[there].astype(np.float32),
        level=np.zeros(1, np.int64),
        waited_s=np.array([1.5]),
        lost_s=np.array([0.25]),
        stop_robot=none.astype(np.int64),
        stop_s=none,
        stop_duration_s=none,
        stop_in_motion=none.astype(np.bool_),
        **FIELDS | fields,
    )


def audited(robot_x, person_x, person_y, robot_y=0.0, vehicle=CART, **fields):
    """What is found of a cart that drives along x with samples each 0.1 s, its trailers behind it, and a person."""
    run, x = record_of_four().execution, np.asarray(robot_x, np.float64)[:, None]
    still, t = np.zeros_like(x), np.arange(len(x)) * 0.1
    y = still + np.reshape(robot_y, (-1, 1))
    speed = np.diff(x, axis=0, prepend=x[:1]) / 0.1
    log = sightings(np.broadcast_to(person_x, len(x)).astype(float), np.broadcast_to(person_y, len(x)).astype(float), **fields)
    hitches = {f"hitch_{n + 1}_rad": still for n in range(len(vehicle.trailers))}
    driven = replace(run, t_s=t, x_m=x, y_m=y, yaw_rad=still, speed_mps=speed, hitch_rad=hitches, people=log)
    return audit(driven, fleet_of(vehicle, 1))


def braking(from_mps, to_m, decel_mps2=1.0):
    """Positions of a cart that drives on at a speed and brakes, by default as hard as it can, to stand at a place."""
    speeds = np.concatenate([np.full(20, from_mps), np.arange(from_mps, 0, -0.1 * decel_mps2), np.zeros(20)])
    x = np.concatenate([[0.0], np.cumsum(speeds * 0.1)])
    return x - x[-1] + to_m


def test_robot_that_drives_into_somebody_who_stands_in_its_way_is_a_failure():
    result = audited(np.arange(60) * 0.1, 3.0, 0.0)
    assert result["num_person_contacts"] == 1 and not result["passed"]
    (contact,) = result["person_contacts"]
    assert contact["kind"] == "too_fast" and contact["t_s"] == pytest.approx((3.0 - 0.25 - 0.3) / 1.0, abs=0.11)
    assert result["num_field_violations"] > 5 and result["min_person_distance_m"] == 0.0


def test_robot_that_is_too_fast_near_somebody_is_a_failure_without_a_contact():
    x = braking(1.0, 3.0 - 0.25 - 0.3 - 0.1)  # it stands 0.1 m before the person
    result = audited(x, 3.0, 0.0)
    assert result["num_person_contacts"] == 0 and result["num_field_violations"] > 0 and not result["passed"]
    assert audited(x, 3.0, 0.0)["min_person_distance_m"] == pytest.approx(0.1, abs=1e-5)


@pytest.mark.parametrize(("robot_x", "finds"), [(2.0, False), (1.0, True)])
def test_fields_are_those_of_the_robot_and_not_of_its_trailers(robot_x, finds):
    """Somebody comes out beside a train, 0.6 m from its middle: beside the tugger, ahead of its trailers, or ahead of all."""
    x = np.arange(40) * 0.1
    result = audited(x, 2.0, np.where(x > robot_x - 0.01, 0.6, 9.0), vehicle=TUGGER)
    assert bool(result["num_field_violations"]) == finds and result["num_person_contacts"] == 0


@pytest.mark.parametrize(("outside_m", "finds"), [(0.002, False), (-0.002, True)])
def test_millimetre_aside_turns_no_field(outside_m, finds):
    """A cart sets out at 0.5 m/s beside somebody who comes into its field only then: a rounded place is no other direction."""
    x = np.concatenate([np.zeros(5), np.arange(1, 10) * 0.05])
    y = np.where(np.arange(len(x)) >= 5, 0.001, 0.0)
    wide_m = 0.001 + CART.width_m / 2 + FIELDS["side_m"] + FIELDS["radius_m"]
    person_y = np.where(np.arange(len(x)) == 5, wide_m + outside_m, np.where(np.isin(np.arange(len(x)), [6, 7]), wide_m - 0.1, 5.0))
    result = audited(x, CART.length_m / 2 + 0.5, person_y, y)
    assert bool(result["num_field_violations"]) == finds
    assert ("robot_0 drives 0.50 m/s, faster than its protective field allows, after 0.7 s" in in_words(result)) == finds


@pytest.mark.parametrize(("decel_mps2", "is_fine"), [(1.0, True), (0.5, False)])
def test_robot_that_brakes_as_hard_as_it_can_from_when_somebody_steps_before_it_is_none(decel_mps2, is_fine):
    x = braking(1.0, 3.0, decel_mps2)
    k = int(np.flatnonzero(np.diff(x, prepend=x[0] - 0.1) < 0.099)[0]) - 1  # the sample after which it brakes
    person_y = np.where(np.arange(len(x)) >= k, 0.0, 3.0)
    result = audited(x, x[k] + 0.3 + 0.25 + 0.8, person_y)
    assert (result["num_field_violations"] == result["num_person_contacts"] == 0) == is_fine


@pytest.mark.parametrize(("slowest_mps", "is_fine"), [(0.19, True), (0.21, False)])
def test_robot_that_may_drive_no_slower_than_its_slowest_has_to_stand(slowest_mps, is_fine):
    """It drives at 0.2 m/s behind somebody, for whom its field allows just that."""
    x = np.arange(40) * 0.02
    ahead_m = FIELDS["extra_m"] + 0.2**2 / 2 + 0.2 * FIELDS["reaction_s"]
    result = audited(x, x + CART.length_m / 2 + FIELDS["radius_m"] + ahead_m, 0.0, slowest_mps=slowest_mps)
    assert (result["num_field_violations"] == 0) == is_fine


def test_person_who_walks_into_a_robot_that_stands_has_done_it():
    result = audited(np.zeros(40), 2.0 - 0.1 * np.arange(40), 0.0)
    assert result["passed"] and result["num_person_touches"] == 1 and result["num_person_contacts"] == 0
    assert result["person_contacts"][0]["kind"] == "standing"


@pytest.mark.parametrize(("beyond_m", "touches"), [(0.17, 1), (0.2, 0)])  # along either axis from the corner: 0.24 m and 0.28 m
def test_person_of_a_quarter_metre_is_beside_a_corner(beyond_m, touches):
    result = audited(np.zeros(4), CART.length_m / 2 + beyond_m, CART.width_m / 2 + beyond_m)
    assert result["num_person_touches"] == touches


def test_person_who_is_gone_has_not_walked_to_where_somebody_is_seen_last():
    """Before a robot that stands, and later behind it."""
    x = np.where(np.arange(20) < 5, 1.5, np.where(np.arange(20) < 12, np.nan, -1.5))
    assert audited(np.zeros(20), x, 0.0)["num_person_touches"] == 0


def test_nothing_is_said_of_people_where_there_are_none():
    result = audit(record_of_four().execution, fleet_of(CART, 4))
    assert result["num_person_contacts"] is None and result["min_person_distance_m"] is None


def test_people_are_read_as_they_were_written(tmp_path):
    t_s, levels = np.arange(30) * 0.1, {"L1": [0.0, 0.0], "L2": [50.0, 0.0]}
    x = np.where(np.arange(30) < 20, 1.0 + 0.1 * np.arange(30), np.nan)
    log = sightings(x, np.full(30, 2.0))
    for shifts in (None, levels):
        write_people(tmp_path / "people.parquet", log, t_s, shifts)
        again = read_people(tmp_path / "people.parquet", np.rint(t_s * 1e9).astype(np.int64), shifts, len(log.lost_s))
        for name in ("first", "person", "x_m", "y_m", "level", "waited_s", "lost_s", "stop_s", *FIELDS):
            assert np.array_equal(getattr(again, name), getattr(log, name)), name


def test_person_at_two_places_at_once_is_refused(tmp_path):
    t_s, log = np.arange(3) * 0.1, sightings(np.array([1.0, 1.1, 1.2]), np.full(3, 2.0))
    twice = replace(log, first=np.array([0, 2, 3, 3]))  # the second sighting is at the first time, too
    write_people(tmp_path / "people.parquet", twice, t_s, None)
    with pytest.raises(MrpSumoError, match="a person is at two places at once"):
        read_people(tmp_path / "people.parquet", np.rint(t_s * 1e9).astype(np.int64), None, len(log.lost_s))
