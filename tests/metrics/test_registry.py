"""The table of metrics is complete, and documentation says what it says."""

import re
from pathlib import Path

import pytest

from mrp_sumo.metrics.metric import Sense, is_value, metric, metric_of
from mrp_sumo.metrics.registry import BY_NAME, METRICS

DOCS = Path(__file__).resolve().parents[2] / "docs" / "metrics.md"
ROW = re.compile(r"^\| `(\w+)`(?: \*)? \| (?:more|less|none) \| .+ \|$", re.M)


def test_names_are_unique_and_every_metric_says_what_it_is():
    assert len(BY_NAME) == len(METRICS)
    for each in METRICS:
        assert each.formula and each.sense in Sense, each.name


def test_unit_is_in_the_name():
    for each in METRICS:
        assert not each.name.endswith("_s") or each.unit == "s", each.name
        assert not each.name.endswith("_m") or each.unit == "m", each.name


def test_documentation_has_a_table_with_every_metric_and_no_other():
    assert sorted(ROW.findall(DOCS.read_text(encoding="utf-8"))) == sorted(BY_NAME)


@pytest.mark.parametrize(
    ("name", "sense"),
    [
        ("min_distance_delta_m", "less"),  # robots that came nearer than they started
        ("min_distance_m", "more"),
        ("min_clearance_m", "more"),
        ("lower_bound_steps", "more"),
        ("plan_valid", "more"),
        ("num_overlaps", "less"),
        ("min_wall_clearance_m", "more"),
        ("num_wall_contacts", "less"),
        ("num_robots", "none"),
    ],
)
def test_sense(name, sense):
    assert BY_NAME[name].sense == sense


def test_function_becomes_the_metric_of_its_name():
    @metric("J", "less", "what the motors took")
    def energy(run):
        return 3.0

    def waiting_s(run):
        """Seconds at a standstill."""
        return 1

    assert (energy.name, energy.unit, energy.sense, energy.formula) == ("energy", "J", "less", "what the motors took")
    plain = metric_of(waiting_s)
    assert (plain.name, plain.unit, plain.sense, plain.formula) == ("waiting_s", "s", "none", "Seconds at a standstill")
    assert plain.label == "waiting"


@pytest.mark.parametrize(
    ("value", "fits"), [(1, True), (0.5, True), (True, True), (None, True), ([1.0, 2], True), ([None], False), ("a", False), (1e999, False)]
)
def test_value_of_a_metric_is_a_finite_number_a_flag_or_a_list(value, fits):
    assert is_value(value) is fits
