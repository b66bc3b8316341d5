"""The check of a face works for functions and objects as it does for classes."""

from dataclasses import dataclass
from typing import Protocol

import pytest

from mrp_sumo.errors import PlugInError
from mrp_sumo.plugins.face import check_face


class Measure(Protocol):
    """A function with a unit."""

    unit: str

    def __call__(self, run, fleet):
        """Measure."""


def of_two(run, fleet):
    return 0.0


def of_one(run):
    return 0.0


of_two.unit = of_one.unit = "s"


@dataclass
class Held:
    unit: object = "s"

    def __call__(self, run, fleet):
        return 0.0


def test_functions_and_objects_have_faces():
    check_face(of_two, Measure, "metric")
    check_face(Held(), Measure, "metric")


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (of_one, r"test_face.py:2[0-9]: of_one is no metric: it has of_one\(run\), expected __call__\(run, fleet\)"),
        (lambda run, fleet: 0.0, "is no metric: it has no attribute 'unit'"),
        (Held(3), "test_face.py:3[0-9]: Held is no metric: 'unit' is 3, expected str"),
        (3, r"int is no metric: it has no method __call__\(run, fleet\)"),
    ],
)
def test_what_is_missing_is_named(made, says):
    with pytest.raises(PlugInError, match=says):
        check_face(made, Measure, "metric")
