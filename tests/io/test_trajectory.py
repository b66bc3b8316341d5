"""The trajectory table keeps every bit, and says what it holds."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from mrp_sumo.core.execution import Execution, Outcome
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.io import trajectory
from mrp_sumo.io.trajectory import read_trajectory, write_trajectory


def wandering(samples=50, robots=7, seed=0):
    rng = np.random.default_rng(seed)
    columns = rng.normal(0, 10, (4, samples, robots))
    t = np.arange(samples) * 0.1
    return Execution(t, *columns, np.zeros(0), np.zeros(robots), Outcome.COMPLETED, "adg", 5.0, 1.0, 1.0)


def names(n):
    return tuple(f"robot_{i}" for i in range(n))


def test_every_bit_comes_back(tmp_path, monkeypatch):
    monkeypatch.setattr(trajectory, "ROWS_PER_GROUP", 100)  # several row groups
    execution = wandering()
    write_trajectory(tmp_path / "t.parquet", execution, names(7), {"seed": 3})
    result = read_trajectory(tmp_path / "t.parquet")
    for column in trajectory.COLUMNS:
        assert np.array_equal(getattr(result, column), getattr(execution, column)), column
    assert result.t_ns.tolist() == [k * 100_000_000 for k in range(50)]
    assert result.robot_name == names(7)
    assert result.metadata["seed"] == 3 and result.metadata["units"]["x_m"] == "m"


def test_robots_off_the_floor_have_no_row(tmp_path):
    execution = wandering(samples=5, robots=2)
    for column in trajectory.COLUMNS:
        getattr(execution, column)[2:4, 1] = np.nan
        getattr(execution, column)[4] = np.nan
    write_trajectory(tmp_path / "t.parquet", execution, names(2), {})
    assert pq.read_metadata(tmp_path / "t.parquet").num_rows == 6
    result = read_trajectory(tmp_path / "t.parquet")
    assert np.array_equal(result.x_m, execution.x_m, equal_nan=True)


def test_equal_executions_give_equal_bytes(tmp_path):
    for name in ("a", "b"):
        write_trajectory(tmp_path / name, wandering(), names(7), {"versions": {"numpy": "2"}})
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_layout_is_a_long_table_for_pandas(tmp_path):
    write_trajectory(tmp_path / "t.parquet", wandering(), names(7), {})
    schema = pq.read_schema(tmp_path / "t.parquet")
    assert schema.names == ["t_ns", "robot", "x_m", "y_m", "yaw_rad", "speed_mps"]
    assert pa.types.is_dictionary(schema.field("robot").type)
    column = pq.read_metadata(tmp_path / "t.parquet").row_group(0).column(2)
    assert column.compression == "ZSTD" and "BYTE_STREAM_SPLIT" in column.encodings


def test_other_files_are_refused(tmp_path):
    (tmp_path / "x.parquet").write_bytes(b"no parquet")
    with pytest.raises(MrpSumoError, match=r"x\.parquet: not a readable Parquet file"):
        read_trajectory(tmp_path / "x.parquet")
    pq.write_table(pa.table({"a": [1]}), tmp_path / "y.parquet")
    with pytest.raises(MrpSumoError, match="schema version no trajectory, expected 1"):
        read_trajectory(tmp_path / "y.parquet")
    with pytest.raises(MrpSumoError, match="no such file"):
        read_trajectory(tmp_path / "z.parquet")


def test_uneven_stamps_come_back(tmp_path):
    execution = wandering(samples=4, robots=1)
    uneven = Execution(**{**vars(execution), "t_s": np.array([0.0, 0.1, 0.4, 0.5])})
    write_trajectory(tmp_path / "t.parquet", uneven, names(1), {})
    assert read_trajectory(tmp_path / "t.parquet").t_ns.tolist() == [0, 100_000_000, 400_000_000, 500_000_000]


def test_levels_come_back_in_the_order_of_the_graph(tmp_path):
    """Metadata have them by the alphabet; a level that the graph does not have is none of its run."""
    execution = wandering(samples=2, robots=1)
    execution = Execution(**{**vars(execution), "level": np.array([[0], [1]])})
    write_trajectory(tmp_path / "t.parquet", execution, names(1), {}, {"upper": (0.0, 0.0), "ground": (0.0, -12.0)})
    result = read_trajectory(tmp_path / "t.parquet", ("upper", "ground"))
    assert result.level.tolist() == [[0], [1]] and result.levels == {"upper": (0.0, 0.0), "ground": (0.0, -12.0)}
    assert list(result.levels) == ["upper", "ground"]
    assert np.allclose(result.y_m, execution.y_m, atol=1e-12)
    with pytest.raises(MrpSumoError, match=r"t\.parquet: its levels are ground, upper, expected L1, ground"):
        read_trajectory(tmp_path / "t.parquet", ("L1", "ground"))
