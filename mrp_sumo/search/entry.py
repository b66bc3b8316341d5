"""Kernels called without a look at the types of their arguments."""

from collections.abc import Callable
from typing import Any

from mrp_sumo.search._kernel import Kernel


def entry_for(kernel: Callable[..., Any], *arguments: Any) -> Callable[..., Any]:
    """The machine code of a kernel, for arguments of the types of these.

    For a caller that hands over the same arrays again and again: to find the types of eighty arrays takes as long as the
    controller's work for a hundred robots. Arguments of other types are undefined behaviour.
    """
    return kernel.entry(*arguments) if isinstance(kernel, Kernel) else kernel  # which is Python's with NUMBA_DISABLE_JIT
