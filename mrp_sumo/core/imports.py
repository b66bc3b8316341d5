"""Keeps libraries from loading what nobody here asks them for."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def without(*modules: str) -> Iterator[None]:
    """Let libraries be imported as if these modules were not installed, unless they are loaded already.

    For what a library loads just in case and does without: it can be slower to load than the library itself.
    """
    absent = {name: None for name in modules if name not in sys.modules}
    sys.modules.update(absent)  # type: ignore[arg-type]  # None: importing it fails
    try:
        yield
    finally:
        for name in absent:
            sys.modules.pop(name, None)
