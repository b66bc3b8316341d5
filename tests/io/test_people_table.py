"""People of a folder that may be anybody's."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.io.arrow import KEY
from mrp_sumo.io.people_table import FIGURES, LISTED, read_people

SAMPLES_NS = np.array([0, 10**9])
ABOUT = {**{name: [] for name in LISTED}, "level": [0], "waited_s": [0.0], **dict.fromkeys(FIGURES)}


def table(path, t_ns):
    """One person, at some times."""
    columns = {"t_ns": t_ns, "person": pa.array([0] * len(t_ns), pa.int32()), **{name: [1.0] * len(t_ns) for name in ("x_m", "y_m")}}
    pq.write_table(pa.table(columns).replace_schema_metadata({KEY: json.dumps(ABOUT)}), path)
    return path


def test_people_are_somewhere_at_samples(tmp_path):
    log = read_people(table(tmp_path / "people.parquet", [0, 10**9]), SAMPLES_NS, None, 0)
    assert log.first.tolist() == [0, 1, 2]
    with pytest.raises(MrpSumoError, match=r"people\.parquet: a person is somewhere at a time of no sample"):
        read_people(table(tmp_path / "people.parquet", [0, 5 * 10**8, 10**9]), SAMPLES_NS, None, 0)
