"""Tables of anybody's folders: each column is what its reader takes it for, or one line says where it is not."""

import json

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from mrp_sumo.errors import BatchError, MrpSumoError
from mrp_sumo.io.facilities import DOORS, read_facilities
from mrp_sumo.io.results import load_results
from mrp_sumo.io.tables import read_table


def table_of(tmp_path, about=None, **columns):
    path = tmp_path / "t.parquet"
    pq.write_table(pa.table(columns).replace_schema_metadata({"mrp_sumo": json.dumps(about)}), path, compression="zstd")
    return read_table(path)


def fault(ask):
    with pytest.raises(MrpSumoError) as error:
        ask()
    line = str(error.value)
    assert "\n" not in line
    return line.partition("t.parquet: ")[2]


def test_columns_come_as_arrays_and_what_is_missing_as_asked(tmp_path):
    table = table_of(
        tmp_path,
        t_s=[0.0, None, 2.5],
        count=pa.array([1, 2, 3], pa.uint8()),
        robot=pa.array(["b", None, "a"]).dictionary_encode(),
        word=["x", "y", "x"],
        yes=[True, False, True],
    )
    assert np.array_equal(table.numbers("t_s", missing=np.inf), [0, np.inf, 2.5])
    assert table.integers("count", 1, 3).tolist() == [1, 2, 3] and table.numbers("count").tolist() == [1, 2, 3]
    assert table.indices("robot", ["a", "b"], missing=-1).tolist() == [1, -1, 0]
    assert table.indices("word", {"x": 7, "y": 9}).tolist() == [7, 9, 7]
    assert table.texts("word") == ("x", "y", "x") and table.flags("yes").tolist() == [True, False, True]
    assert table.as_written().schema.field("word").type == pa.string()


@pytest.mark.parametrize(
    ("values", "ask", "line"),
    [
        ([1.0, None], lambda t: t.numbers("c"), "column 'c', row 1: found nothing, expected a value"),
        ([1.0, float("nan")], lambda t: t.numbers("c", missing=0.0), "column 'c', row 1: found nan, expected a number"),
        ([float("inf"), 1.0], lambda t: t.numbers("c"), "column 'c', row 0: found inf, expected a number"),
        ([1.0, -1e308], lambda t: t.numbers("c"), "column 'c', row 1: found -1e+308, expected a number below 1e+100"),
        (["1", "2"], lambda t: t.numbers("c"), "column 'c' holds string, expected numbers"),
        ([1.0, 2.0], lambda t: t.integers("c"), "column 'c' holds double, expected whole numbers"),
        ([0, 3], lambda t: t.integers("c", 0, 2), "column 'c', row 1: found 3, expected 0 to 2"),
        ([0, -1], lambda t: t.integers("c", 0), "column 'c', row 1: found -1, expected 0 or more"),
        (pa.array([2**64 - 1, 0], pa.uint64()), lambda t: t.integers("c"), "column 'c', row 0: found 18446744073709551615"),
        ([[1], [2]], lambda t: t.numbers("c"), "column 'c' holds list<"),
        ([1, 0], lambda t: t.flags("c"), "column 'c' holds int64, expected true or false"),
        ([1, 0], lambda t: t.texts("c"), "column 'c' holds int64, expected texts"),
        (["a", None], lambda t: t.texts("c"), "column 'c', row 1: found nothing, expected a value"),
        (
            ["robot_0", "robot_l"],
            lambda t: t.indices("c", ["robot_0", "robot_1"]),
            "column 'c', row 1: found 'robot_l' (did you mean 'robot_",
        ),
        ([None, None], lambda t: t.indices("c", ["a"], missing=-1), "column 'c' holds null, expected texts"),
        ([1, 2], lambda t: t.numbers("d"), "no column 'd', so it is of another version of this program, or damaged (known: c)"),
        ([0.0, 2.0, 1.5], lambda t: t.times("c"), "column 'c', row 2: found 1.5, expected 2.0 or more"),
    ],
)
def test_column_that_is_something_else_is_named_with_its_row(tmp_path, values, ask, line):
    assert fault(lambda: ask(table_of(tmp_path, c=values))).startswith(line)


def test_times_may_be_equal_but_not_go_back(tmp_path):
    assert table_of(tmp_path, t_s=[0.0, 1.5, 1.5]).times("t_s").tolist() == [0, 1.5, 1.5]


def test_two_columns_of_one_name_are_refused(tmp_path):
    path = tmp_path / "t.parquet"
    pq.write_table(pa.table([[1], [2]], names=["c", "c"]), path)
    assert fault(lambda: read_table(path)) == "two columns 'c'"


def test_metadata_do_not_say_what_a_column_is_for_others(tmp_path):
    path = tmp_path / "t.parquet"
    frame = pa.Table.from_pandas(pd.DataFrame({"yes": pd.array([True], "boolean")}))
    pq.write_table(frame.set_column(0, "yes", pa.array([0.5])), path)
    assert read_table(path).as_written().to_pandas()["yes"].tolist() == [0.5]


@pytest.mark.parametrize(
    ("about", "ask", "line"),
    [
        ({"a": [1, "2"]}, lambda t: t.about_numbers("a"), "its metadata have no 'a', expected a list of numbers"),
        ({"a": [1, 2]}, lambda t: t.about_numbers("a", 3), "its metadata have no 'a', expected a list of 3 numbers"),
        ({"a": [10**400]}, lambda t: t.about_numbers("a"), "a number of 'a' in its metadata is too large"),
        ({"a": True}, lambda t: t.about_number("a"), "its metadata have no 'a', expected a number"),
        (["x", "x"], lambda t: t.about_texts(), "expected a list of different names"),
        ({"a": [1]}, lambda t: t.about_texts("a"), "its metadata have no 'a', expected a list of different names"),
        (None, lambda t: t.about_numbers("a"), "its metadata have no 'a'"),
    ],
)
def test_metadata_are_checked_as_columns_are(tmp_path, about, ask, line):
    assert line in fault(lambda: ask(table_of(tmp_path, about, c=[1])))


def test_metadata_that_are_right_come_back(tmp_path):
    table = table_of(tmp_path, {"a": [1, 2.5], "b": None, "c": ["x", "y"]}, d=[1])
    assert table.about_numbers("a", 2).tolist() == [1, 2.5] and np.isnan(table.about_number("b", missing=np.nan))
    assert table.about_texts("c") == ("x", "y")


def test_small_file_of_many_rows_is_refused_before_it_is_read(tmp_path):
    path = tmp_path / "t.parquet"
    rows = pa.table({"x": pa.array(np.zeros(10_000_000, np.int64)), "y": pa.array(np.zeros(10_000_000))})
    with pq.ParquetWriter(path, rows.schema, compression="zstd") as writer:
        for _ in range(15):
            writer.write_table(rows)
    assert path.stat().st_size < 2**21
    assert fault(lambda: read_table(path)).startswith("150000000 rows would take ")


def test_text_that_rows_repeat_is_kept_once_and_not_written_out(tmp_path):
    table = table_of(tmp_path, c=pa.DictionaryArray.from_arrays(pa.array(np.zeros(5000, np.int32)), ["x" * 2**20]))
    assert len(table.texts("c")) == 5000
    assert fault(table.as_written) == "its texts would take 5 GB, which is not read"


def test_what_is_no_table_is_the_callers_error(tmp_path):
    (tmp_path / "t.parquet").write_bytes(b"PAR1nonsensePAR1")
    with pytest.raises(BatchError, match="not a readable Parquet file"):
        read_table(tmp_path / "t.parquet", error=BatchError)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"success": [0.5]}, "column 'success' holds double, expected true or false"),
        ({"status": [None]}, "column 'status' holds null, expected texts"),
        ({"robots.count": [[1]]}, "column 'robots.count' holds list<"),
    ],
)
def test_table_of_results_has_the_columns_of_runs(tmp_path, changes, line):
    columns = {"key": ["k"], "scenario_key": ["s"], "status": ["planned"], "success": [True], "robots.count": [1]}
    pq.write_table(pa.table(columns), path := tmp_path / "t.parquet")
    assert load_results(path)["robots.count"].tolist() == [1]
    pq.write_table(pa.table(columns | changes), path)
    assert fault(lambda: load_results(path)).startswith(line)


def test_facility_that_no_row_tells_of_is_named(tmp_path):
    row = {"t_s": [0.0], "door": ["a"], "state": ["closed"], "robot": [""]}
    for names, line in ((["a"], ""), (["a", "b"], "no row says how door 'b' is")):
        pq.write_table(pa.table(row).replace_schema_metadata({"mrp_sumo": json.dumps(names)}), tmp_path / DOORS)
        if line:
            with pytest.raises(MrpSumoError, match=line):
                read_facilities(tmp_path, ["r"], ["L1"])
        else:
            assert read_facilities(tmp_path, ["r"], ["L1"]).door_name == ("a",)
