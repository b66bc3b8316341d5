"""Kernels: functions that numba compiles when they are first called, and that are stored for all later processes.

A compiled kernel contains the kernels that it calls, so it is good as long as none of their sources change. The kernels
of a room are therefore stored in a folder named by the hash of all kernel sources that they may import, those of the room
and of `search`, and of Python and the compiler; numba itself tells processors apart. The folder is in `NUMBA_CACHE_DIR`
where that is set, else in the user's cache folder, so that all copies of the same sources share it. It may be deleted at any time.

Stored kernels are programs: only folders that nobody else can write to are used. Numba would run a damaged file, so the
checksums of a kernel's files are beside them, and files without one are dropped and compiled again.

Numba takes half a second to load, so it is loaded when the first kernel is called. All that is used of it is documented.
"""

import atexit
import hashlib
import os
import sys
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, cached_property, partial, update_wrapper
from importlib.metadata import version
from pathlib import Path
from shutil import rmtree
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
SHARED = ("mrp_sumo/core", "mrp_sumo/search")  # kernels of all rooms may import from here
COMPILER = ("numba", "llvmlite")
MOST_FOLDERS = 8  # of different sources that are kept for a room; the least recently used go first
CHECKSUMS = "checksums"  # the file that holds a line for each of the others in its folder: checksum, name

_defined: list[Path] = []  # folders of the kernels that this process has defined
_shown: list[Callable[[], None]] = []  # to be called before a kernel is compiled
_unsealed: set[Path] = set()  # folders into which kernels were stored since their checksums were written


def kernel(function: Callable[..., Any] | None = None, *, inline: str = "never", allocates: bool = False, nogil: bool = False) -> Any:
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
        Whether it makes arrays, or calls a kernel that does: one that does without saying so is not compiled. References of arrays are
        counted only there: without, to hand tuples of arrays from stage to stage costs nothing.
    nogil
        Whether other threads may run while Python waits for it. Two threads may then write the same array at once: give each its own.
    """
    if function is None:
        return partial(kernel, inline=inline, allocates=allocates, nogil=nogil)
    if not is_compiled():
        return function
    return Kernel(function, {"inline": inline, "_nrt": allocates, "nogil": nogil})


def is_compiled() -> bool:
    """True if kernels are compiled; with NUMBA_DISABLE_JIT they are what they are in Python."""
    return os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0")


class Kernel:
    """A kernel as Python calls it."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        update_wrapper(self, function)
        self.__wrapped__ = self.py_func = function
        self.options = self.targetoptions = options  # here, and in `py_func`, numba looks for what is to be inlined
        self.is_inner = function.__name__.startswith("_")
        self.folder = kernel_folder(function)  # None where nothing can be stored
        if self.folder:
            _defined.append(self.folder)

    def __call__(self, *arguments: Any) -> Any:
        if self.is_inner:
            raise TypeError(f"{self.__wrapped__.__name__} is called by kernels only: its name begins with '_'")
        try:
            return self.dispatcher(*arguments)
        finally:
            if _unsealed:
                seal()

    def entry(self, *arguments: Any) -> Callable[..., Any]:
        """The machine code for arguments of the types of these: loaded, or compiled. Arguments of other types are undefined behaviour."""
        from numba import typeof

        code: Callable[..., Any] = self.dispatcher.compile(tuple(map(typeof, arguments)))
        seal()
        return code

    @cached_property
    def dispatcher(self) -> Any:
        """The kernel as numba compiles it."""
        if self.folder:
            _drop_unsound(self.folder)
        return _compiler()(self.__wrapped__, self.options, self.is_inner, self.folder is not None)

    @property
    def num_types(self) -> int:
        """For how many sets of argument types there is machine code in this process."""
        return len(self.dispatcher.signatures) if "dispatcher" in vars(self) else 0


@cache
def _compiler() -> Callable[[Callable[..., Any], dict[str, Any], bool, bool], Any]:
    """The function that makes numba's dispatchers; numba is loaded for it, and told of kernels."""
    import numba
    from numba import types
    from numba.core import event
    from numba.extending import models, register_model, typeof_impl

    config: Any = numba.config
    njit: Any = numba.njit
    dispatcher_type: Any = types.Dispatcher
    tuple_type: Any = types.Tuple

    class Show(event.Listener):
        """Shows those who wait that a kernel is about to be compiled."""

        def on_start(self, event: object) -> None:
            seal()  # what was compiled before
            for show in _shown:
                show()

        def on_end(self, event: object) -> None:
            """It is not stored yet."""

    def widened(argument: Any) -> Any:
        if isinstance(argument, (types.UniTuple, types.Tuple)):
            return tuple_type(tuple(map(widened, argument)))
        argument = getattr(argument, "literal_type", argument)
        return types.int64 if argument == types.int32 else argument

    class KernelType(dispatcher_type):  # type: ignore[misc]
        """The type of a kernel that a kernel calls: constants and narrow integers among its arguments make no further copies of it."""

        def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
            return super().get_call_type(context, tuple(map(widened, args)), {key: widened(each) for key, each in kws.items()})

    register_model(KernelType)(models.OpaqueModel)
    typeof_impl.register(Kernel)(lambda kernel, _: KernelType(kernel.dispatcher))
    event.register("numba:compile", Show())  # type: ignore[no-untyped-call]
    atexit.register(seal)

    def dispatcher(function: Callable[..., Any], options: dict[str, Any], is_inner: bool, is_stored: bool) -> Any:
        locators, config.CACHE_LOCATOR_CLASSES = config.CACHE_LOCATOR_CLASSES, f"{__name__}.Locator"
        try:
            return njit(**options, cache=is_stored, no_cpython_wrapper=is_inner, no_cfunc_wrapper=True)(function)
        finally:
            config.CACHE_LOCATOR_CLASSES = locators

    return dispatcher


class Locator:
    """A kernel's folder, as numba asks for it; see NUMBA_CACHE_LOCATOR_CLASSES in its documentation."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> "Locator | None":
        folder = kernel_folder(py_func)
        return cls(folder) if folder else None

    def get_cache_path(self) -> str:
        return str(self._folder)

    def ensure_cache_path(self) -> None:
        """Numba is about to store machine code."""
        self._folder.mkdir(mode=0o700, exist_ok=True)
        _unsealed.add(self._folder)

    def get_source_stamp(self) -> str:
        return ""  # the room's folder is named by the hash of the sources

    def get_disambiguator(self) -> str:
        return ""  # it has the folder to itself


def seal() -> None:
    """Write the checksums of what was stored: from now on it is loaded."""
    while _unsealed:
        folder = _unsealed.pop()
        with suppress(OSError):  # the folder was deleted, or the disk is full: they are compiled again
            lines = "".join(f"{_checksum(file)} {file.name}\n" for file in sorted(_stored_in(folder)))
            draft = folder / f"{CHECKSUMS}.{os.getpid()}"
            draft.write_text(lines, encoding="utf-8")
            draft.replace(folder / CHECKSUMS)


def _drop_unsound(folder: Path) -> None:
    """Delete all that is not what was stored, whatever it is."""
    with suppress(OSError):  # nothing is stored
        if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
            folder.unlink()
        for each in folder.iterdir():
            if each.is_symlink() or not each.is_file():
                rmtree(each) if each.is_dir() and not each.is_symlink() else each.unlink()
        lines = (folder / CHECKSUMS).read_text(encoding="utf-8", errors="replace").split("\n") if (folder / CHECKSUMS).exists() else []
        sound = {name: checksum for checksum, _, name in (line.partition(" ") for line in lines)}
        for file in _stored_in(folder):
            if sound.get(file.name) != _checksum(file):
                file.unlink()


def _stored_in(folder: Path) -> list[Path]:
    return [file for file in folder.iterdir() if file.suffix in (".nbi", ".nbc")]


def _checksum(file: Path) -> str:
    return f"{zlib.crc32(file.read_bytes()):08x}"


class UnstoredKernels:
    """The kernels that this process has defined and that were not stored when they were first looked for."""

    def __init__(self) -> None:
        self._seen = 0
        self._folders: list[Path] = []

    @property
    def num_kernels(self) -> int:
        self._folders += [folder for folder in _defined[self._seen :] if not folder.exists()]
        self._seen = len(_defined)
        return len(self._folders)

    @property
    def num_stored(self) -> int:
        """Number of them that are stored by now, by whichever process."""
        return sum(folder.exists() for folder in self._folders)


@contextmanager
def each_compiled(show: Callable[[], None]) -> Iterator[None]:
    """Call `show` before each kernel that is compiled inside."""
    _shown.append(show)
    try:
        yield
    finally:
        _shown.remove(show)


def is_empty(room: str) -> bool:
    """True if the kernels of a room could be stored, and none is."""
    return is_compiled() and room_folder(room) is not None and num_stored(room) == 0


def num_stored(room: str) -> int:
    """Number of kernels of a room that are stored."""
    folder = room_folder(room)
    with suppress(FileNotFoundError):  # another process may have dropped it since
        return sum(1 for _ in folder.iterdir()) if folder else 0
    return 0


def num_defined(room: str) -> int:
    """Number of kernels that the sources of a room define."""
    return sum(file.read_text(encoding="utf-8").count("\n@kernel") for file in (ROOT / room).rglob("_*.py"))


def room_of(module: str) -> str:
    """The folder whose kernels are stored together: a room of mrp_sumo, or `planners`."""
    parts = module.split(".")
    return "/".join(parts[:2]) if parts[0] == "mrp_sumo" else parts[0]


def kernel_folder(function: Callable[..., Any]) -> Path | None:
    """The folder of a kernel's machine code, which need not exist; None where nothing can be stored."""
    room = room_folder(room_of(function.__module__))
    name = function.__qualname__.replace("<", "").replace(">", "")
    return room / f"{function.__module__}-{name}-{function.__code__.co_firstlineno}" if room else None


@cache
def room_folder(room: str) -> Path | None:
    """The folder of the machine code of a room's kernels; None where there is no folder that this user alone can write to."""
    cache_home = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    ours = Path(cache_home) / "mrp-sumo"
    folder = ours / "kernels" / f"{room.replace('/', '.')}-{state_of_sources(ROOT, room)}"
    try:
        for each in (ours, ours / "kernels", folder):
            each.mkdir(parents=True, exist_ok=True, mode=0o700)
            status = each.stat()
            if status.st_uid != os.getuid() or status.st_mode & 0o022:
                return None
        os.utime(folder)
        if not os.access(folder, os.W_OK | os.X_OK):
            return None
        _drop_least_used(folder.parent.glob(folder.name.rpartition("-")[0] + "-*"))
    except OSError:
        return None
    return folder


def state_of_sources(root: Path, room: str) -> str:
    """A hash of all that decides what the compiled kernels of a room do: their sources' text, Python and the compiler.

    Their sources are the files whose name begins with `_` and that define kernels, or constants only, those that define
    NamedTuples: a kernel finds their fields by number, and this file.

    Parameters
    ----------
    root, room
        The folder that the packages are in; the room in it.
    """
    state = hashlib.sha256(" ".join((sys.version, *map(version, COMPILER))).encode())
    for folder in sorted({room, *SHARED}):
        for file in sorted((root / folder).rglob("*.py")):
            text = file.read_bytes()
            is_kernel = file.match("_[!_]*.py") and (b"@kernel" in text or b"def " not in text)
            if is_kernel or b"(NamedTuple)" in text or file.name == Path(__file__).name:
                state.update(file.relative_to(root).as_posix().encode() + b"\0" + text + b"\0")
    return state.hexdigest()[:20]


def _drop_least_used(folders: Iterable[Path]) -> None:
    used = sorted(folders, key=lambda f: f.stat().st_mtime, reverse=True)
    for old in used[MOST_FOLDERS:]:
        rmtree(old, ignore_errors=True)
