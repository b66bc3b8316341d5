"""Kernels called without a look at the types of their arguments."""

from collections.abc import Callable
from typing import Any

from numba.core.dispatcher import Dispatcher


def entry_for(kernel: Callable[..., Any], *arguments: Any) -> Callable[..., Any]:
    """The machine code of a kernel, for arguments of the types of these.

    For a caller that hands over the same arrays again and again: to find the types of eighty arrays takes as long as the
    controller's work for a hundred robots. Arguments of other types are undefined behaviour.
    """
    if not isinstance(kernel, Dispatcher):  # NUMBA_DISABLE_JIT
        return kernel
    entry: Callable[..., Any] = kernel.compile(tuple(kernel.typeof_pyval(argument) for argument in arguments))
    return entry
