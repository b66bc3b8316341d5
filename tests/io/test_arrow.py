"""Arrow arrays of numpy's."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from mrp_sumo.io import arrow
from mrp_sumo.io.arrow import numbers, texts


@pytest.mark.parametrize("values", [[1, -2], [0.5, np.inf], [True, False, True, True, False, False, True, False, True], []])
def test_numbers_and_truth_values_stay_as_they_are(values):
    array = numbers(np.array(values))
    assert array.to_pylist() == values
    array.validate(full=True)


@pytest.mark.parametrize("values", [[], ["a", "", "ü"], ["a", None, "ü", None]])
def test_texts_are_those_of_pyarrow(values):
    assert texts(values).equals(pa.array(values, pa.string()))
    texts(values).validate(full=True)


def test_tables_of_runs_are_made_without_pandas():
    """`pyarrow.array` imports it, which costs every run half a second."""
    folder = Path(arrow.__file__).parent
    assert [path.name for path in folder.glob("*.py") if "pa.array(" in path.read_text()] == ["results.py"]
