"""YAML as PyYAML's safe loader reads it, and refusals of what nobody should parse."""

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from mrp_sumo.errors import MapError
from mrp_sumo.maps.yaml_text import MAX_BYTES, Text, parse, read_text


def read(text):
    from pathlib import Path

    return parse(Text(Path("map.yaml"), text))


SCALARS = ["1", "-3", "+4", "010", "0x1F", "1_000", "1:30", "1.5", "-2.", ".5", "1e5", "1.0e+5", "1e-05", ".nan", ".inf", "yes", "No", "on"]
SCALARS += ["true", "~", "null", "L1", "'5'", '"no"', "1.2.3", "0", "-0", "00", "1:2.5"]


@pytest.mark.parametrize("scalar", SCALARS)
def test_scalars_are_those_of_the_safe_loader(scalar):
    ours, theirs = read(f"[{scalar}, x]"), yaml.safe_load(f"[{scalar}, x]")
    assert repr(ours) == repr(theirs)


def test_bytes_of_a_command_line_that_are_no_text_are_refused():
    with pytest.raises(MapError, match=r"^map\.yaml: not UTF-8 text$"):
        read("seed: \udcff")


def test_dates_stay_text():
    assert read("day: 2020-01-01") == {"day": "2020-01-01"}


JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**6), 10**6) | st.floats(allow_nan=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=20,
)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(JSON, st.sampled_from([None, False, True]))
def test_documents_are_those_of_the_safe_loader(document, style):
    text = yaml.safe_dump(document, default_flow_style=style, allow_unicode=True)
    assert read(text) == yaml.safe_load(text)


def test_anchors_repeat_values():
    assert read("a: &x [1, 2]\nb: *x\nc: &y 3\nd: *y") == {"a": [1, 2], "b": [1, 2], "c": 3, "d": 3}


BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n" + "".join(f"a{k + 1}: &a{k + 1} [{', '.join([f'*a{k}'] * 10)}]\n" for k in range(9))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BOMB, "map.yaml:5: aliases repeat more than 100000 values"),
        ("[" * 5000, "map.yaml:1: nested deeper than 30 levels"),
        ("a: *b", "map.yaml:1: "),
        ("a: &a [*a]", "alias '*a' has no anchor before it"),
        ("a: 1\nb: !!python/object/apply:os.system ['true']", "map.yaml:2: tag"),
        ("a: {b: 1}\nc: {<<: {d: 1}}", "map.yaml:2: merge keys are not read"),
        ("? [1, 2]\n: 3", "a list or mapping as a key"),
        ("a: 1\n---\nb: 2", "map.yaml:2: a second YAML document"),
        ("a: [1, 2", "not YAML"),
        ('a: "long\n<<<<<<< HEAD\ntext"', "map.yaml:2: not YAML: git conflict marker '<<<<<<<'"),
        ("a: 1\n<<<<<<< HEAD\nb: 2\n=======\nb: 3\n>>>>>>> other", "map.yaml:2: not YAML: git conflict marker '<<<<<<<'"),
        ("<!DOCTYPE html>\n<html><body>404: not found {</body></html>", "map.yaml:1: not YAML: an HTML page"),
    ],
)
def test_what_must_not_be_parsed_is_refused_with_its_line(text, message):
    with pytest.raises(MapError) as error:
        read(text)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_faults_are_pointed_at_by_line():
    source = Text(__import__("pathlib").Path("map.yaml"), "levels:\n  L1:\n    lanes:\n      - [0, 1]\n      - [1, 2]\n")
    assert str(source.fault("wrong", "levels", "L1", "lanes", 1)) == "map.yaml:5: wrong"
    assert str(source.fault("wrong", "levels", "L1", "doors", 1)) == "map.yaml:3: wrong"  # as far as it exists


def test_files_that_are_no_text_are_refused(tmp_path):
    path = tmp_path / "map.yaml"
    for data, message in ((b"\x89PNG\0\0", "binary data"), (b"name: caf\xe9\n", "map.yaml:1: not UTF-8")):
        path.write_bytes(data)
        with pytest.raises(MapError, match=message):
            read_text(path)
    with pytest.raises(MapError, match="no such file"):
        read_text(tmp_path / "none.yaml")
    with pytest.raises(MapError, match="is a folder"):
        read_text(tmp_path)
    with path.open("wb") as file:
        file.truncate(MAX_BYTES + 1)  # sparse: takes no space
    with pytest.raises(MapError, match="64 MB; above 64 MB nothing is read"):
        read_text(path)
