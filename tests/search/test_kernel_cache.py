"""The cache of compiled kernels follows the files they are made of."""

import os

from mrp_sumo.search import kernel_cache


def test_kernel_is_dropped_when_a_file_it_imports_from_is_newer(tmp_path):
    files = {"p._a": tmp_path / "_a.py", "p._b": tmp_path / "_b.py", "p._c": tmp_path / "_c.py"}
    files["p._a"].write_text("from p._b import f\n")
    files["p._b"].write_text("from p._c import g\n")
    files["p._c"].write_text("")
    (tmp_path / "__pycache__").mkdir()
    index = {name: tmp_path / "__pycache__" / f"{path.stem}.f-1.py311.nbi" for name, path in files.items()}
    for time, paths in ((100, files.values()), (200, index.values())):
        for path in paths:
            path.touch()
            os.utime(path, (time, time))
    assert [kernel_cache._drop(*pair) for pair in kernel_cache._newest(files)] == [0, 0, 0]
    os.utime(files["p._b"], (300, 300))
    assert [kernel_cache._drop(*pair) for pair in kernel_cache._newest(files)] == [1, 1, 0]
    assert [index[name].exists() for name in files] == [False, False, True]
