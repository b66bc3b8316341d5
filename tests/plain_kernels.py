"""Kernels as plain Python, so that none is compiled and each line can be tested in no time."""

from types import ModuleType

import pytest


def as_plain_python(monkeypatch: pytest.MonkeyPatch, *modules: ModuleType) -> None:
    """Have the kernels of some modules call each other as Python functions."""
    for module in modules:
        for name, value in vars(module).items():
            if hasattr(value, "py_func"):
                monkeypatch.setattr(module, name, value.py_func)
