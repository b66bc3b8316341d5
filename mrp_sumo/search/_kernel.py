"""Kernels: functions that numba compiles when they are first called, and that are stored for all later processes.

A compiled kernel contains the kernels that it calls, so it is good as long as none of their sources change. The kernels
of a room are therefore stored in a folder named by the hash of all kernel sources that they may import, those of the room
and of `search`, and of Python and the compiler; the processor is part of numba's own key. The folder is in
`NUMBA_CACHE_DIR` where that is set, else in the user's cache folder, so that all copies of the same sources share it. It
may be deleted at any time.
"""

import hashlib
import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from shutil import rmtree
from typing import Any

from mrp_sumo.core.imports import without

with without("scipy", "coverage"):  # for BLAS, which no kernel calls, and for lines that it cannot see
    import numba
import llvmlite
from llvmlite.binding import parse_assembly, parse_bitcode
from numba.core import event
from numba.core.caching import Cache, CompileResultCacheImpl, _CacheLocator
from numba.core.codegen import JITCodeLibrary
from numba.core.dispatcher import Dispatcher
from numba.core.funcdesc import default_mangler
from numba.core.runtime import rtsys
from numba.core.types import int32, int64, unliteral

ROOT = Path(__file__).resolve().parents[2]
SHARED = ("mrp_sumo/core", "mrp_sumo/search")  # kernels of all rooms may import from here
MOST_FOLDERS = 8  # of different sources that are kept for a room; the least recently used go first

_LOOKED_UP = re.compile(rb"_ZN(?:7cpython|08NumbaEnv)[^\0]+")  # symbols in machine code: its entry, and the constants of its functions

_defined: list[Path] = []  # index files of the kernels that this process has defined
_apart: set[str] = set()  # full names of kernels whose machine code their callers share


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
    inner = function.__name__.startswith("_")
    compiled = numba.njit(inline=inline, _nrt=allocates, nogil=nogil, no_cpython_wrapper=inner, no_cfunc_wrapper=True)(function)
    if not isinstance(compiled, Dispatcher):  # NUMBA_DISABLE_JIT
        return compiled
    if inner:
        compiled._compile_for_args = partial(_refuse, function.__name__)
    if apart:
        _apart.add(f"{function.__module__}.{function.__qualname__}")
    compiled.add_overload = partial(_add_overload, compiled, inner, apart)
    if folder(room_of(function.__module__)):
        compiled._cache = _KernelCache(function)
        _defined.append(Path(compiled._cache._cache_file._index_path))
    compiled.get_call_template = partial(_template_of_few_types, compiled.get_call_template)
    return compiled


def _template_of_few_types(template_of, args, kws):
    return template_of([_widened(a) for a in args], {key: _widened(a) for key, a in kws.items()})


def _widened(argument):
    argument = unliteral(argument)
    return int64 if argument == int32 else argument


def _refuse(name, *_, **__):
    raise TypeError(f"{name} is called by kernels only: its name begins with '_'")


def _add_overload(compiled, inner, apart, found):
    arguments = tuple(found.signature.args)
    if apart:
        found.library.apart = (compiled.py_func.__module__, compiled.py_func.__qualname__, arguments)
    if inner:
        compiled.overloads[arguments] = found  # not for calls from Python, which would look for their way in
    else:
        type(compiled).add_overload(compiled, found)


def _mangled(name, types, *, abi_tags=(), uid=None):
    """As numba's, but the same in all processes for a kernel that others call by its name: there is no other of its name."""
    return default_mangler(name, types, abi_tags=abi_tags, uid=None if name.removeprefix(".NumbaEnv.") in _apart else uid)


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
    with event.install_listener("numba:compile", _Show(show)):
        yield


class _Show(event.Listener):
    def __init__(self, show: Callable[[], None]) -> None:
        self._show = show

    def on_start(self, event: Any) -> None:
        self._show()

    def on_end(self, event: Any) -> None:
        """It is not stored yet: that is for the next to show."""


def is_empty(room: str) -> bool:
    """Whether the kernels of a room could be stored, and none is."""
    found = folder(room)
    return not numba.config.DISABLE_JIT and found is not None and num_stored(room) == 0


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

    Their sources are the files whose name begins with `_` and that define kernels, or constants only, and those that define
    NamedTuples: a kernel finds their fields by number.

    Parameters
    ----------
    root, room
        The folder that the packages are in; the room in it.
    """
    state = hashlib.sha256(f"{sys.version} {numba.__version__} {llvmlite.__version__}".encode())
    for folder in sorted({room, *SHARED}):
        for file in sorted((root / folder).rglob("*.py")):
            text = file.read_bytes()
            is_kernel = file.match("_[!_]*.py") and (b"@kernel" in text or b"def " not in text)
            if is_kernel or b"(NamedTuple)" in text:
                state.update(file.relative_to(root).as_posix().encode() + b"\0" + text + b"\0")
    return state.hexdigest()[:20]


def _drop_least_used(folders: Iterable[Path]) -> None:
    used = sorted(folders, key=lambda f: f.stat().st_mtime, reverse=True)
    for old in used[MOST_FOLDERS:]:
        rmtree(old, ignore_errors=True)


class _Locator(_CacheLocator):
    """Tells numba the folder; the kernel's module is part of its file's name."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> "_Locator":
        return cls(py_func)

    def get_cache_path(self) -> str:
        return str(folder(room_of(self._function.__module__)))

    def get_source_stamp(self) -> str:
        return ""  # the folder's name is the stamp

    def get_disambiguator(self) -> str:
        return f"{self._function.__module__}-{self._function.__code__.co_firstlineno}"


class _KernelCacheImpl(CompileResultCacheImpl):
    _locator_classes = (_Locator,)


class _KernelCache(Cache):
    _impl_class = _KernelCacheImpl

    def load_overload(self, sig, target_context):
        """As numba's, but what only the compiler needs is loaded when there is something to compile."""
        rtsys.initialize(target_context)
        target_context.codegen()._library_class = _Library
        target_context.mangler = _mangled
        with without("scipy.linalg"):
            with self._guard_against_spurious_io_errors():
                found = self._load_overload(sig, target_context)
            if found is None:
                target_context.refresh()
        return found


class _Library(JITCodeLibrary):
    """Machine code; what a caller of it is compiled from is parsed when there is a caller to compile, for it takes longer than loading.

    A kernel that is kept apart gives its callers nothing to be compiled from. They hold its name, which the linker finds in the machine
    code that is loaded, so it is loaded before them.
    """

    apart: tuple[str, str, tuple[Any, ...]] | None = None  # module, name and argument types of the kernel, if it is kept apart
    _bitcode: bytes | None = None
    _loaded_before: tuple[Any, ...] = ()

    def serialize_using_object_code(self):
        name, kind, data = super().serialize_using_object_code()
        return name, kind, (*data, self._callees_apart())

    def _callees_apart(self):
        found = set(self._loaded_before)
        for library in self._linking_libraries:
            if isinstance(library, _Library):
                found |= {library.apart} if library.apart else set(library._callees_apart())
        return tuple(sorted(found, key=str))

    @classmethod
    def _unserialize(cls, codegen, state):
        name, kind, data = state
        if kind != "object":
            return super()._unserialize(codegen, state)
        library = codegen.create_library(name)
        machine_code, library._bitcode, library._loaded_before = data
        for module, kernel_name, arguments in library._loaded_before:
            getattr(import_module(module), kernel_name).compile(arguments)
        library.enable_object_caching()
        library._set_compiled_object(machine_code)
        library._finalize_final_module()
        codegen._engine._defined_symbols.update(found.decode() for found in set(_LOOKED_UP.findall(machine_code)))
        return library

    def _get_module_for_linking(self):
        self._ensure_finalized()
        if self.apart:
            return parse_assembly(str(self._codegen._create_empty_module(self.name)))
        if self._bitcode is not None:
            self._shared_module = parse_bitcode(self._bitcode)
            self._codegen._engine._load_defined_symbols(self._shared_module)
            self._bitcode = None
        return super()._get_module_for_linking()
