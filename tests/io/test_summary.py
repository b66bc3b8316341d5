"""Objects in a few lines."""

from mrp_sumo.errors import count
from mrp_sumo.io.summary import seconds, summary


def test_lines_without_a_value_are_left_out_and_names_aligned():
    output = summary("Run", [("a", 1), ("longer", "x"), ("none", None), ("empty", ""), ("zero", 0)])
    assert output.text == "Run\n  a       1\n  longer  x\n  zero    0"


def test_names_cannot_bring_markup_with_them():
    output = summary("<b>", [("<i>", "a & <script>")]).html
    assert "<script>" not in output and "&lt;script&gt;" in output and "&lt;b&gt;" in output and "&lt;i&gt;" in output


def test_counts_and_durations_read_well():
    assert [count(1, "robot"), count(1234, "robot"), count(2, "vertex", "vertices")] == ["1 robot", "1,234 robots", "2 vertices"]
    assert [seconds(None), seconds(0.0), seconds(0.0123), seconds(80.5)] == ["", "0 s", "12.3 ms", "80.5 s"]
