"""A few runs tell what quantities do within their intervals, and which matters most; what is no quantity is refused in a line."""

from pathlib import Path

import numpy as np
import pytest

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.error_bands import (
    Effect,
    Quantity,
    as_changes,
    between,
    corner,
    design,
    effects,
    most,
    quantities,
    spans,
    value_of,
    values_at,
)
from mrp_sumo.experiments.statistics import Interval
from mrp_sumo.io.scenario.read import scenario_of

SHAPE = {"length_m": 0.5, "width_m": 0.5, "max_speed_mps": 1.0, "accel_mps2": 1.0, "decel_mps2": 1.0, "turn_rate_rad_s": 1.0}
STREAM = {"arrivals": {"rate_per_h": 60.0}, "stops": ["a", "b"]}


def scenario(robot=None, disturbances=None, robots=None, **tasks):
    values = {"map": "office", "robots": robots or {"count": 2, "type": robot or SHAPE}, "planner": "lacam"}
    values |= {"tasks": {"streams": [STREAM], **tasks}, "execution": {"disturbances": disturbances or {}}}
    return scenario_of(values, Path(), "case")


@pytest.mark.parametrize("count", [1, 3, 4, 7, 8, 11, 12, 15])
def test_settings_are_balanced_and_of_each_pair_of_quantities_too(count):
    settings = design(count)
    assert np.array_equal(settings.T @ settings, len(settings) * np.eye(count)) and not settings.sum(0).any()
    half = len(settings) // 2
    assert np.array_equal(settings[half:], -settings[:half]) and (settings == -1).all(1).any() and (settings == 1).all(1).any()
    pairs = settings[:, :, None] * settings[:, None, :]
    assert not np.einsum("mi,mjk->ijk", settings, pairs).any()  # clear of what two do together


def quantity(name):
    return Quantity(name, ((("robots", "factor", name), 0.9, 1.1),), False)


def figures(of, formula):
    """What a formula of all quantities says at each setting, and the effects that are told from it."""
    settings = design(len(of))
    rows = [{place[-1]: value for place, value in values_at(of, row).items()} for row in settings.tolist()]
    return effects(of, settings, np.repeat((0, 1), len(settings) // 2), np.array([formula(**row) for row in rows]))


def test_where_one_station_binds_its_time_is_all_that_matters():
    of = [quantity(name) for name in ("speed", "accel", "pack", "ship")]
    first, *others = figures(of, lambda speed, accel, pack, ship: min(3600 / (20 * pack), 40 * 3600 / (300 / speed + 20 * pack)))
    assert first.quantity.name == "pack" and first.change.value == pytest.approx(180 * (1 / 1.1 - 1 / 0.9))
    assert all(effect.change.value == pytest.approx(0, abs=1e-9) for effect in others)
    assert most([first, *others]) == "what matters most is pack"


def test_where_travel_binds_the_speed_matters_most():
    of = [quantity(name) for name in ("speed", "accel", "pack", "ship")]
    formula = lambda speed, accel, pack, ship: 5 * 3600 / (300 / speed + 20 * pack + 10 * ship)  # noqa: E731
    first, second, third, _ = figures(of, formula)
    ends = [np.mean([formula(v, 1, p, s) for p in (0.9, 1.1) for s in (0.9, 1.1)]) for v in (0.9, 1.1)]
    assert first.quantity.name == "speed" and first.change.value == pytest.approx(ends[1] - ends[0], rel=1e-6)
    assert second.quantity.name == "pack" and second.change.value == pytest.approx(2 * third.change.value, rel=0.01)
    assert corner([first, second], better=False) == {("robots", "factor", "speed"): 0.9, ("robots", "factor", "pack"): 1.1}


def test_ends_that_look_the_same_are_said_once():
    assert (between(47.99, 48.01, ".0f"), between(47.4, 48.01, ".0f")) == ("48", "47 to 48")


def test_limits_hold_the_truth_and_chance_is_not_named():
    of, rng = [quantity(f"q{k}") for k in range(7)], np.random.default_rng(1)
    settings, held, named = design(7), 0, 0
    for _ in range(200):
        result = effects(of, settings, np.repeat((0, 1), 8), settings[:, 2] * 2.0 + rng.normal(0, 1.0, 16) + np.repeat((5, 9), 8))
        held += sum(effect.change.low <= (4.0 if effect.quantity is of[2] else 0.0) <= effect.change.high for effect in result)
        named += result[0].quantity is of[2]
    assert 0.93 <= held / 1400 <= 0.97 and named > 190
    nothing = effects(of, settings, np.zeros(16), np.full(16, 3.0))
    assert most(nothing) == "none of these quantities stands out from chance"


def test_runs_without_a_figure_are_left_out():
    of, settings = [quantity("speed"), quantity("pack")], design(2)
    figures = np.array([np.nan, *(10.0 + settings[1:, 0])])
    first, _ = effects(of, settings, np.zeros(len(settings)), figures)
    assert first.quantity.name == "speed" and first.change.value == pytest.approx(2.0) and first.change.count == len(settings) - 1
    assert np.isnan(effects(of, settings, np.zeros(len(settings)), np.full(len(settings), np.nan))[0].change.value)


def test_intervals_come_from_the_user_then_from_the_type_and_are_ten_per_cent_else():
    robot = {**SHAPE, "intervals": {"max_speed_mps": [0.8, 1.0], "accel_mps2": [0.5, 1.5]}}
    file = scenario(robot, {"stops_per_s": 0.01, "intervals": {"stops_per_s": [0.0, 0.03]}}, service_factor={"b": 2.0})
    of = {q.name: q for q in quantities(file, {"robots.type.accel_mps2": (0.9, 1.2), "tasks.service_factor.a": (1.0, 1.0)}, ["b", "a"])}
    ends = {name: [value for _, *bounds in q.ends for value in bounds] for name, q in of.items()}
    assert ends == {
        "the top speed": [0.8, 1.0],
        "acceleration": [0.9, 1.2],
        "how often robots stop": [0.0, 0.03],
        "turning": pytest.approx([0.9, 1.1]),
        "how long robots stop": pytest.approx([2.7, 3.3]),
        "braking": pytest.approx([0.9, 1.1]),
        "the time at b": pytest.approx([1.8, 2.2]),
    }  # and nothing of `a`, which is known exactly
    assert spans(tuple(of.values())) == "these intervals (10 % up and down where none is known)"


def test_the_fourth_station_and_those_after_it_move_together():
    of = quantities(scenario(), {}, [f"s{k}" for k in range(6)])
    alone = ["the top speed", "turning", "the time at s0", "the time at s1", "the time at s2"]
    assert [q.name for q in of] == [*alone, "acceleration and braking", "the times at the other stations"]
    assert [place[-1] for place, _, _ in of[-1].ends] == ["s3", "s4", "s5"]


@pytest.mark.parametrize(
    ("params", "says"),
    [
        ({"robots.type.max_speed": (1, 2)}, r"--interval robots.type.max_speed: unknown key \(did you mean 'robots.type.max_speed_mps'"),
        ({"robots.type.length_m": (1, 2)}, "--interval robots.type.length_m: expected one of robots.type.max_speed_mps"),
        ({"robots.type.max_speed_mps": (1.1, 2)}, "found 1.1:2, expected the scenario's value within it, 1"),
        ({"robots.type.max_speed_mps": (2, 0.5)}, "found 2:0.5, expected the scenario's value within it, 1"),
        ({"planner.name": (1, 2)}, "--interval planner.name: the scenario has no number there"),
        ({f"tasks.service_factor.s{k}": (0.5, 2) for k in range(16)}, "19 quantities would move, expected at most 15"),
    ],
)
def test_what_is_no_quantity_is_refused_in_a_line(params, says):
    with pytest.raises(MrpSumoError, match=says) as raised:
        design(len(quantities(scenario(), params, ())))
    assert "\n" not in str(raised.value)


def effect(name, change, low=None, high=None, params=False):
    quantity = Quantity(name, ((("robots", "factor", name), 0.91234567, 1.1),), params)
    return Effect(quantity, Interval(change, change - 1 if low is None else low, change + 1 if high is None else high, 8))


@pytest.mark.parametrize(("low", "high", "sure"), [(0.1, 9, True), (0.0, 9, False), (-9, 0.0, False), (-9, -0.1, True), (-1, 1, False)])
def test_an_effect_is_sure_where_its_limits_are_on_one_side_of_nothing(low, high, sure):
    assert effect("a", 3.0, low, high).is_sure == sure


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ((-10.0, 8.1), "what matters most is a and b"),
        ((10.0, -8.0), "what matters most is a"),
        ((10.0, 9.0, 9.0), "what matters most is a and b"),
        ((0.5, 0.4), "none of these quantities stands out from chance"),
    ],
)
def test_the_second_is_named_beside_the_first_where_it_has_more_than_four_fifths_of_its_effect(changes, says):
    assert most([effect(name, change) for name, change in zip("abc", changes)]) == says


def test_an_effect_is_written_with_four_digits():
    assert effect("a", 1.23456789, 0.5, 2.0, True).document == {
        "name": "a",
        "intervals": {"robots.factor.a": [0.9123, 1.1]},
        "given": True,
        "effect": 1.235,
        "low": 0.5,
        "high": 2.0,
    }


@pytest.mark.parametrize(("better", "more", "values"), [(True, True, (1.1, 0.9)), (True, False, (0.9, 1.1)), (False, False, (1.1, 0.9))])
def test_at_a_better_corner_a_figure_is_larger_or_smaller(better, more, values):
    both = [Effect(quantity(name), Interval(change, change - 1, change + 1, 8)) for name, change in (("a", 5.0), ("b", -4.0))]
    assert tuple(corner(both, better, more).values()) == values


@pytest.mark.parametrize(("half", "at_best"), [(1.0, (0.9, 1.1)), (9.0, (1.1, 0.9))], ids=("sure", "chance"))
@pytest.mark.parametrize("more", [True, False])
def test_where_chance_alone_may_have_made_an_effect_faster_is_better(half, at_best, more):
    """Speed seems to harm and longer services to help, by 5: that is believed only where limits say so."""
    places = {("robots", "factor", "max_speed_mps"): -5.0, ("tasks", "service_factor", "pack"): 5.0}
    both = [
        Effect(Quantity(str(place), ((place, 0.9, 1.1),), False), Interval(sign * change, sign * change - half, sign * change + half, 8))
        for place, change in places.items()
        for sign in [1.0 if more else -1.0]
    ]
    assert tuple(corner(both, True, more).values()) == at_best
    assert tuple(corner(both, False, more).values()) == at_best[::-1]


@pytest.mark.parametrize(
    ("params", "says"),
    [
        ((False, False), "10 % up and down of what is assumed"),
        ((True, True), "these intervals"),
        ((True, False), "these intervals (10 % up and down where none is known)"),
    ],
)
def test_whose_intervals_they_are_is_said(params, says):
    assert spans([Quantity("a", (), each) for each in params]) == says


def test_keys_are_moved_as_they_are_and_figures_of_types_by_the_factor_of_the_fleet():
    """The type's 1 m/s, now 0.8 by its factor: 0.5 and 2 m/s are factors of 0.5 and 2."""
    robots = {"count": 2, "type": SHAPE, "factor": {"max_speed_mps": 0.8}}
    file = scenario(None, {"stops_per_s": 0.01, "speed_noise": 0.1}, robots)
    bounds = {
        "robots.type.max_speed_mps": (0.5, 2.0),
        "robots.factor.accel_mps2": (0.7, 1.2),
        "execution.disturbances.stops_per_s": (0.0, 0.02),
        "tasks.service_factor.a": (1.0, 1.5),
    }
    ends = {".".join(place): (low, high) for each in quantities(file, bounds, ()) if each.is_given for place, low, high in each.ends}
    assert ends == {
        "robots.factor.max_speed_mps": pytest.approx((0.5, 2.0)),
        "robots.factor.accel_mps2": (0.7, 1.2),
        "execution.disturbances.stops_per_s": (0.0, 0.02),
        "tasks.service_factor.a": (1.0, 1.5),
    }
    assert [each.name for each in quantities(file, {}, ()) if each.name.startswith(("how", "the scatter"))] == [
        "how often robots stop",
        "how long robots stop",
        "the scatter of the speed",
    ]
    changes = as_changes({("execution", "disturbances", "stops_per_s"): 0.02, ("robots", "factor", "accel_mps2"): 0.7})
    assert {place: value for place, (_, value) in changes.items()} == {
        ("execution", "disturbances", "stops_per_s"): 0.02,
        ("robots", "factor", "accel_mps2"): 0.7,
        ("execution", "disturbances", "intervals", "stops_per_s"): [0.02, 0.02],
    }


def test_what_a_scenario_does_not_have_is_no_quantity():
    """Neither how long robots stop that never do, nor how those turn that cannot."""
    car = {key: value for key, value in SHAPE.items() if key != "turn_rate_rad_s"}
    car["kinematics"] = {"kind": "ackermann", "wheelbase_m": 0.3, "steering_max_rad": 0.6}
    for robot, turns in ((SHAPE, ["turning"]), (car, [])):
        assert [each.name for each in quantities(scenario(robot), {}, ())] == ["the top speed", *turns, "acceleration and braking"]


@pytest.mark.parametrize(
    ("key", "value"),
    [("tasks.service_factor.b", 2.0), ("tasks.service_factor.a", 1.0), ("robots.count", 2.0), ("execution.blocking_window_s", 10.0)],
)
def test_values_are_those_of_the_scenario(key, value):
    assert value_of(scenario(service_factor={"b": 2.0}), key) == value


def test_a_figure_in_which_types_differ_is_refused_and_carried_intervals_are_the_widest():
    slow = {**SHAPE, "max_speed_mps": 0.5, "intervals": {"max_speed_mps": [0.4, 0.55]}}
    fast = {**SHAPE, "intervals": {"max_speed_mps": [0.9, 1.3]}}
    file = scenario(robots={"fleet": [{"type": each, "count": 1} for each in (slow, fast)]})
    (speed,) = (each for each in quantities(file, {}, ()) if each.name == "the top speed")
    assert speed.ends[0][1:] == pytest.approx((0.8, 1.3))
    with pytest.raises(MrpSumoError, match=r"types of the fleet differ in it, expected robots.factor.max_speed_mps, a factor on all"):
        value_of(file, "robots.type.max_speed_mps")
    assert value_of(file, "robots.type.accel_mps2") == 1.0
