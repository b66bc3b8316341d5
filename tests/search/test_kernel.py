"""Compiled kernels follow the sources of all that they call."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mrp_sumo.search import _kernel

CALLEE = "from mrp_sumo.search._kernel import kernel\nfrom planners._constants import THREE\n\n@kernel\ndef steps():\n    return THREE\n"
CALLER = "from mrp_sumo.search._kernel import kernel\nfrom planners._callee import steps\n\n@kernel\ndef twice():\n    return 2 * steps()\n"
CALL = "from planners._caller import twice; print(twice(), len(twice.dispatcher.stats.cache_hits))"


@pytest.fixture
def copied(tmp_path):
    """Makes a copy of the package with two kernels, one of which calls the other."""

    def copy(name):
        root = tmp_path / name
        for folder in ("mrp_sumo/search", "planners"):
            (root / folder).mkdir(parents=True)
        for package in ("mrp_sumo", "mrp_sumo/search", "planners"):
            (root / package / "__init__.py").touch()
        shutil.copy(_kernel.__file__, root / "mrp_sumo/search/_kernel.py")
        (root / "planners/_constants.py").write_text("THREE = 3\n")
        (root / "planners/_callee.py").write_text(CALLEE)
        (root / "planners/_caller.py").write_text(CALLER)
        return root

    return copy


def printed(root, cache, program):
    """What a program prints."""
    # bytecode is looked up by time and size, which are to be equal here
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(filter(None, (str(root), os.environ.get("PYTHONPATH")))),
        "NUMBA_CACHE_DIR": str(cache),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    done = subprocess.run([sys.executable, "-c", program], env=environment, cwd=root, capture_output=True, text=True, check=True)
    return done.stdout


def answer(root, cache):
    """What the caller returns, and whether it was loaded instead of compiled."""
    return tuple(map(int, printed(root, cache, CALL).split()))


@pytest.mark.slow
@pytest.mark.parametrize(("file", "old", "new"), [("_callee.py", "return THREE", "return 5"), ("_constants.py", "= 3", "= 5")])
def test_caller_is_compiled_again_after_its_callee_changed(copied, tmp_path, file, old, new):
    root = copied("one")
    assert [answer(root, tmp_path / "cache") for _ in range(2)] == [(6, 0), (6, 1)]
    edited = root / "planners" / file
    modified = edited.stat().st_mtime_ns
    edited.write_text(edited.read_text().replace(old, new))
    os.utime(edited, ns=(modified, modified))
    assert answer(root, tmp_path / "cache") == (10, 0)


def test_sources_with_the_fields_that_kernels_find_by_number_count_too(tmp_path):
    fields = tmp_path / "mrp_sumo/drive/state.py"
    fields.parent.mkdir(parents=True)
    states = set()
    for text in ("", "class A(NamedTuple):\n    x: int\n    y: int\n", "class A(NamedTuple):\n    y: int\n    x: int\n"):
        fields.write_text(text)
        states.add(_kernel.state_of_sources(tmp_path, "mrp_sumo/drive"))
    assert len(states) == 3


@pytest.mark.slow
def test_copies_of_the_same_sources_share_their_kernels(copied, tmp_path):
    assert answer(copied("one"), tmp_path / "cache") == (6, 0)
    assert answer(copied("other"), tmp_path / "cache") == (6, 1)


@pytest.mark.slow
def test_caller_is_compiled_from_a_loaded_callee_and_loaded_without_it(copied, tmp_path):
    root = copied("one")
    callee = "from planners._callee import steps; print(steps(), len(steps.dispatcher.stats.cache_hits)); "
    assert printed(root, tmp_path / "cache", callee) == "3 0\n"
    assert printed(root, tmp_path / "cache", callee + CALL) == "3 1\n6 0\n"
    assert answer(root, tmp_path / "cache") == (6, 1)


DAMAGES = {
    "empty": lambda data: b"",
    "half": lambda data: data[: len(data) // 2],
    "zeros": lambda data: bytes(len(data)),
    "one bit": lambda data: data[: len(data) // 2] + bytes([data[len(data) // 2] ^ 1]) + data[len(data) // 2 + 1 :],
    "longer": lambda data: data + b"x",
    "text": lambda data: b"cos\nsystem\n(S'false'\ntR.",
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
@pytest.mark.parametrize("name", ["a.py311.nbi", "a.py311.1.nbc"])
def test_damaged_file_is_dropped_and_the_others_stay(tmp_path, name, damage):
    names = {"a.py311.nbi", "a.py311.1.nbc", "a.py311.2.nbc"}
    for each in names:
        (tmp_path / each).write_bytes(each.encode())
    _kernel._unsealed.add(tmp_path)
    _kernel.seal()
    _kernel._drop_unsound(tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {*names, "checksums"}
    (tmp_path / name).write_bytes(damage(name.encode()))
    _kernel._drop_unsound(tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {*names, "checksums"} - {name}


@pytest.mark.parametrize("name", ["a.py311.nbi", "checksums", ""])
@pytest.mark.parametrize("replaced", [Path.mkdir, lambda path: path.symlink_to("/dev/zero"), lambda path: os.mkfifo(path)])
def test_what_is_no_file_is_dropped_unread(tmp_path, name, replaced):
    folder = tmp_path / "kernel"
    folder.mkdir()
    (folder / "a.py311.nbi").write_bytes(b"code")
    _kernel._unsealed.add(folder)
    _kernel.seal()
    shutil.rmtree(folder / name) if not name else (folder / name).unlink()
    replaced(folder / name)
    _kernel._drop_unsound(folder)
    assert not folder.is_dir() or "a.py311.nbi" not in {file.name for file in folder.iterdir()}
    folder.mkdir(exist_ok=True)
    (folder / "a.py311.nbi").write_bytes(b"new")
    _kernel._unsealed.add(folder)
    _kernel.seal()
    _kernel._drop_unsound(folder)
    assert {file.name for file in folder.iterdir()} == {"a.py311.nbi", "checksums"}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["_caller.*.nbc", "_caller.*.nbi", "checksums"])
def test_damaged_kernel_is_compiled_again_without_a_word(copied, tmp_path, kind):
    root, cache = copied("one"), tmp_path / "cache"
    assert answer(root, cache) == (6, 0)
    (file,) = cache.glob(f"mrp-sumo/kernels/*/planners._caller-*/{kind}")
    file.write_bytes(DAMAGES["one bit"](file.read_bytes()))
    assert [answer(root, cache) for _ in range(2)] == [(6, 0), (6, 1)]


@pytest.mark.slow
def test_kernel_that_was_stored_without_its_checksum_is_compiled_again(copied, tmp_path):
    root, cache = copied("one"), tmp_path / "cache"
    assert answer(root, cache) == (6, 0)
    for file in cache.rglob("checksums"):
        file.unlink()  # as if the process had been killed before
    assert answer(root, cache) == (6, 0)
    assert answer(root, cache) == (6, 1)


@pytest.mark.slow
@pytest.mark.parametrize("level", ["", "kernels"])
def test_nothing_is_loaded_from_where_others_can_write(copied, tmp_path, level):
    root, cache = copied("one"), tmp_path / "cache"
    assert answer(root, cache) == (6, 0)
    (cache / "mrp-sumo" / level).chmod(0o777)
    assert [answer(root, cache) for _ in range(2)] == [(6, 0), (6, 0)]
    (cache / "mrp-sumo" / level).chmod(0o700)
    assert answer(root, cache) == (6, 1)


OTHERS = """
import numba

@numba.njit(cache=True)
def mine(a):
    return a * 2

print(mine(21.0), len(mine.stats.cache_hits))
"""


@pytest.mark.slow
def test_functions_of_other_programs_are_stored_as_numba_stores_them(copied, tmp_path):
    root = copied("one")
    (root / "others.py").write_text(OTHERS)
    assert printed(root, tmp_path / "cache", f"{CALL}; import others") == "6 0\n42.0 0\n"
    assert printed(root, tmp_path / "cache", "import others") == "42.0 1\n"
    assert not [file for file in (tmp_path / "cache/mrp-sumo").rglob("*") if "others" in file.name]
    assert printed(root, tmp_path / "cache", f"import others; {CALL}") == "42.0 1\n6 1\n"


@pytest.mark.slow
def test_loaded_kernel_makes_arrays_and_raises_errors(copied, tmp_path):
    root = copied("one")
    (root / "planners/_callee.py").write_text(
        "import numpy as np\nfrom mrp_sumo.search._kernel import kernel\n\n@kernel(allocates=True)\ndef zeros(n):\n"
        "    if n < 0:\n        raise ValueError('less than none', n)\n    return np.zeros(n)\n"
    )
    call = (
        "from planners._callee import zeros\nprint(zeros(2), len(zeros.dispatcher.stats.cache_hits))\n"
        "try:\n    zeros(-1)\nexcept ValueError as error:\n    print(error.args)"
    )
    for loaded in range(2):
        assert printed(root, tmp_path / "cache", call) == f"[0. 0.] {loaded}\n('less than none', -1)\n"


@pytest.mark.slow
def test_kernel_works_where_nothing_can_be_written(copied, tmp_path):
    (tmp_path / "cache").write_text("a file, not a folder")
    assert answer(copied("one"), tmp_path / "cache") == (6, 0)


def test_folders_used_least_recently_are_dropped(tmp_path):
    for k in range(_kernel.MOST_FOLDERS + 2):
        (tmp_path / f"{k}").mkdir()
        os.utime(tmp_path / f"{k}", (k, k))
    _kernel._drop_least_used(tmp_path.iterdir())
    assert sorted(int(f.name) for f in tmp_path.iterdir()) == list(range(2, _kernel.MOST_FOLDERS + 2))


def test_folder_that_another_process_has_dropped_has_no_kernels(monkeypatch, tmp_path):
    monkeypatch.setattr(_kernel, "room_folder", lambda room: tmp_path / room)
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "kernel").mkdir()
    assert [_kernel.num_stored(room) for room in ("kept", "dropped")] == [1, 0]


def test_kernels_import_nothing_of_ours_but_what_the_state_covers():
    """Kernels, or constants without any function, of the same room or of search; tuples of arrays also from core."""
    packages = ("mrp_sumo", "planners")
    for file in [f for package in packages for f in (_kernel.ROOT / package).rglob("_*.py") if "\n@kernel" in f.read_text()]:
        room = _kernel.room_of(".".join(file.relative_to(_kernel.ROOT).parts))
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module.split(".")[0] in packages:
                source = _kernel.ROOT / (node.module.replace(".", "/") + ".py")
                if "(NamedTuple)" in source.read_text() and all(alias.name[0].isupper() for alias in node.names):
                    assert _kernel.room_of(node.module) in (room, *_kernel.SHARED), (file, source)
                    continue
                assert _kernel.room_of(node.module) in (room, "mrp_sumo/search"), (file, source)
                assert source.name.startswith("_"), (file, source)
                assert "@kernel" in source.read_text() or "def " not in source.read_text(), (file, source)


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")
def test_constants_as_arguments_make_no_further_copies(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    from mrp_sumo.search._kernel import kernel

    inner = kernel(_inner)
    outer = kernel(_outer_of(inner))
    assert outer(2) == 3 + 4 + 2
    assert len(inner.dispatcher.signatures) == 1


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")
def test_kernel_that_is_to_be_inlined_is_part_of_its_callers(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    from mrp_sumo.search._kernel import kernel

    inner = kernel(_inner, inline="always")
    outer = kernel(_outer_of(inner))
    assert outer(2) == 3 + 4 + 2
    assert not inner.num_types


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")
def test_narrow_integers_make_no_further_copies_and_private_kernels_are_for_kernels_only(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    from mrp_sumo.search._kernel import kernel

    inner = kernel(_inner)
    first_of = kernel(_first_of(inner))
    assert [first_of(np.array([2], dtype)) for dtype in (np.int64, np.int32)] == [3, 3]
    assert len(inner.dispatcher.signatures) == 1
    with pytest.raises(TypeError, match=r"^_inner is called by kernels only"):
        inner(2)


def _inner(x):
    return x + 1


def _first_of(inner):
    def first_of(values):
        return inner(values[0])

    return first_of


def _outer_of(inner):
    def outer(n):
        return inner(2) + inner(3) + inner(n - 1)

    return outer
