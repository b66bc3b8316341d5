"""Machine code of kernels by the types of arrays that change seldom.

At each call numba finds out what the arrays are, which for fifty of them takes longer than many a kernel does.
"""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from mrp_sumo.search._kernel import Kernel

Entries = dict[Callable[..., Any], Callable[..., Any]]  # kernel -> its machine code for some types

_by_types: dict[tuple[object, ...], Entries] = {}


def entries_of(values: Iterable[object]) -> Entries:
    """The machine code of kernels that were called with values of the same types: all those of their arguments whose type may change."""
    types = ((each.dtype, each.flags.writeable, each.flags.c_contiguous) if isinstance(each, np.ndarray) else type(each) for each in values)
    return _by_types.setdefault(tuple(types), {})


def enter(entries: Entries, kernel: Callable[..., Any], *arguments: Any) -> Any:
    """Call a kernel by its machine code, which is looked for the first time."""
    entry = entries.get(kernel)
    if entry is None:
        entry = entries[kernel] = kernel.entry(*arguments) if isinstance(kernel, Kernel) else kernel  # Python's with NUMBA_DISABLE_JIT
    return entry(*arguments)
