"""Kernels: functions that numba compiles when they are first called, and that are stored for all later processes.

A compiled kernel contains the kernels that it calls, so it is good as long as none of their sources change. The kernels
of a room are therefore stored in a folder named by the hash of all kernel sources that they may import, those of the room
and of `search`, and of Python and the compiler; the processor is part of each kernel's own key. The folder is in
`NUMBA_CACHE_DIR` where that is set, else in the user's cache folder, so that all copies of the same sources share it. It
may be deleted at any time.

Numba takes longer to load than most plans to find. It is loaded when there is something to compile (`_compiler`); what is stored is
called without it (`_stored`).
"""

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable, Hashable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache, cached_property, partial, update_wrapper
from pathlib import Path
from shutil import rmtree
from typing import Any

from mrp_sumo.search import _stored

ROOT = Path(__file__).resolve().parents[2]
SHARED = ("mrp_sumo/core", "mrp_sumo/search")  # kernels of all rooms may import from here
COMPILER = ("numba", "llvmlite")
MACHINERY = ("_kernel", "_compiler", "_stored")  # sources that decide what is stored
MOST_FOLDERS = 8  # of different sources that are kept for a room; the least recently used go first

_defined: list[Path] = []  # index files of the kernels that this process has defined
_shown: list[Callable[[], None]] = []  # to be called before a kernel is compiled


def kernel(
    function: Callable[..., Any] | None = None, *, inline: str = "never", allocates: bool = True, apart: bool = False, nogil: bool = False
) -> Any:
    """Compile a function when it is called, and store it.

    It is compiled once for each set of argument types; numba alone would also do so for each constant argument, and for each width of
    integer that another kernel hands over. One whose name begins with `_` is for other kernels: the way in from Python, which
    takes long to compile, is left out.

    Parameters
    ----------
    function
        Of arrays, numbers, and NamedTuples of them.
    inline
        'always' puts its statements in the place of each call.
    allocates
        Whether it makes arrays, or calls a kernel that does. References of arrays are counted only where it does: without,
        to hand tuples of arrays from stage to stage costs nothing.
    apart
        Whether kernels that call it share its machine code. Otherwise each has a copy of its own, fitted in and compiled with
        it: right for what is short and called often, slow to compile for what is long. Only at the top level of a module.
    nogil
        Whether other threads may run while Python waits for it. Two threads may then write the same array at once: give each its own.
    """
    if function is None:
        return partial(kernel, inline=inline, allocates=allocates, apart=apart, nogil=nogil)
    if not is_compiled():
        return function
    return Kernel(function, {"inline": inline, "_nrt": allocates, "nogil": nogil}, apart)


def is_compiled() -> bool:
    """Whether kernels are compiled; with NUMBA_DISABLE_JIT they are what they are in Python."""
    return os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0")


class Kernel:
    """A kernel as Python calls it. Numba sees what it knows of its own: `py_func`, `targetoptions` and the type."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any], apart: bool) -> None:
        update_wrapper(self, function)
        self.py_func = function
        self.targetoptions = options
        self.apart = apart
        self.is_inner = function.__name__.startswith("_")
        self.folder = folder(room_of(function.__module__))  # None where nothing can be stored
        self.entries: dict[Hashable, Callable[..., Any]] = {}  # machine code by the types of arguments
        name = function.__qualname__.replace("<", "").replace(">", "")
        self.file_name = f"{function.__module__}-{name}-{function.__code__.co_firstlineno}"  # what its files' names begin with
        if self.folder:
            _defined.append(self.folder / f"{self.file_name}.nbi")

    def __call__(self, *arguments: Any) -> Any:
        entry = self.entries.get(_stored.key_of(arguments))
        return (entry or self.entry(*arguments))(*arguments)

    def entry(self, *arguments: Any) -> Callable[..., Any]:
        """The machine code for arguments of the types of these: loaded, or compiled. Arguments of other types are undefined behaviour."""
        if self.is_inner:
            raise TypeError(f"{self.py_func.__name__} is called by kernels only: its name begins with '_'")
        types = _stored.names(arguments)
        stored = None if types is None else self.stored(types)
        entry = stored.entry if stored else None
        if entry is None:
            entry = self.dispatcher.compile(tuple(map(self.dispatcher.typeof_pyval, arguments)))
        self.entries[_stored.key_of(arguments)] = entry
        return entry

    def stored(self, types: str) -> "_stored.Loaded | None":
        """The stored machine code for arguments of these types; None where there is none that can be loaded."""
        if self.folder is None:
            return None
        return _stored.load(self.folder / _stored.file_name(self.file_name, types), self.py_func)

    @cached_property
    def dispatcher(self) -> Any:
        """The kernel as numba compiles it."""
        from mrp_sumo.search._compiler import dispatcher_of

        return dispatcher_of(self, _compiles)  # type: ignore[no-untyped-call]

    @property
    def _numba_type_(self) -> Any:
        return self.dispatcher._numba_type_


class Missing:
    """The kernels that this process has defined and that were not stored when they were first looked for."""

    def __init__(self) -> None:
        self._seen = 0
        self._file: list[Path] = []

    @property
    def num_kernels(self) -> int:
        self._file += [file for file in _defined[self._seen :] if not file.exists()]
        self._seen = len(_defined)
        return len(self._file)

    @property
    def num_stored(self) -> int:
        """How many of them are stored by now, by whichever process."""
        return sum(file.exists() for file in self._file)


@contextmanager
def each_compiled(show: Callable[[], None]) -> Iterator[None]:
    """Call `show` before each kernel that is compiled inside."""
    _shown.append(show)
    try:
        yield
    finally:
        _shown.remove(show)


def _compiles() -> None:
    """A kernel is about to be compiled: show it to those who wait."""
    for show in _shown:
        show()


def is_empty(room: str) -> bool:
    """Whether the kernels of a room could be stored, and none is."""
    found = folder(room)
    return is_compiled() and found is not None and num_stored(room) == 0


def num_stored(room: str) -> int:
    """How many kernels of a room are stored."""
    found = folder(room)
    return sum(1 for _ in found.glob("*.nbi")) if found else 0


def num_defined(room: str) -> int:
    """How many kernels the sources of a room define."""
    return sum(file.read_text(encoding="utf-8").count("\n@kernel") for file in (ROOT / room).rglob("_*.py"))


def room_of(module: str) -> str:
    """The folder whose kernels are stored together: a room of mrp_sumo, or `planners`."""
    parts = module.split(".")
    return "/".join(parts[:2]) if parts[0] == "mrp_sumo" else parts[0]


@cache
def folder(room: str) -> Path | None:
    """Where kernels of a room are stored; None where there is no folder to write to."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    cache_home = os.environ.get("XDG_CACHE_HOME")
    homes = [Path(cache_home) if cache_home else Path.home() / ".cache", Path(tempfile.gettempdir()) / f"cache-{os.getuid()}"]
    for home in [Path(chosen)] if chosen else homes:
        found = home / "mrp-sumo" / "kernels" / f"{room.replace('/', '.')}-{state_of_sources(ROOT, room)}"
        try:
            found.mkdir(parents=True, exist_ok=True, mode=0o700)
            if found.stat().st_uid != os.getuid():  # a stored kernel of somebody else's is a program of somebody else's
                continue
            os.utime(found)
            tempfile.TemporaryFile(dir=found).close()
            _drop_least_used(found.parent.glob(found.name.rpartition("-")[0] + "-*"))
        except OSError:
            continue
        return found
    return None


def state_of_sources(root: Path, room: str) -> str:
    """A hash of all that decides what the compiled kernels of a room do: their sources' text, Python and the compiler.

    Their sources are the files whose name begins with `_` and that define kernels, or constants only, those that define
    NamedTuples: a kernel finds their fields by number, and this file and those beside it that store and load.

    Parameters
    ----------
    root, room
        The folder that the packages are in; the room in it.
    """
    state = hashlib.sha256(sys.version.encode())
    for package in COMPILER:  # which is not loaded to ask for its version
        state.update(_stored.place_of(package).joinpath("_version.py").read_bytes())
    for folder in sorted({room, *SHARED}):
        for file in sorted((root / folder).rglob("*.py")):
            text = file.read_bytes()
            is_kernel = file.match("_[!_]*.py") and (b"@kernel" in text or b"def " not in text)
            if is_kernel or b"(NamedTuple)" in text or file.stem in MACHINERY:
                state.update(file.relative_to(root).as_posix().encode() + b"\0" + text + b"\0")
    return state.hexdigest()[:20]


def _drop_least_used(folders: Iterable[Path]) -> None:
    used = sorted(folders, key=lambda f: f.stat().st_mtime, reverse=True)
    for old in used[MOST_FOLDERS:]:
        rmtree(old, ignore_errors=True)
