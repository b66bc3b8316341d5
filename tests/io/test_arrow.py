"""Arrow arrays of numpy's."""

import subprocess
import sys

import numpy as np
import pytest

from mrp_sumo.io.arrow import numbers


@pytest.mark.parametrize("values", [[1, -2], [0.5, np.inf], [True, False, True, True, False, False, True, False, True], []])
def test_numbers_and_truth_values_stay_as_they_are(values):
    array = numbers(np.array(values))
    assert array.to_pylist() == values
    array.validate(full=True)


def test_truth_values_need_no_pandas():
    code = "import sys, numpy as np; from mrp_sumo.io.arrow import numbers; numbers(np.ones(9, bool)); print('pandas' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"
