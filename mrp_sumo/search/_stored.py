"""Stored kernels, called without the compiler: half the time of a short command was numba's import, which had nothing to compile.

A file holds the machine code of a kernel for arguments of some types, with the function that numba makes for Python to call: it takes
arguments apart, counts references and raises errors as ever, and nothing of that is done here. All that it needs are LLVM's linker and
three modules that numba has in C, which are loaded by themselves. What cannot be loaded, for want of a file or a symbol, is left to the
compiler.
"""

import builtins
import ctypes
import hashlib
import os
import pickle
import sys
from collections.abc import Callable, Hashable, Iterable
from functools import cache
from importlib import import_module
from importlib.machinery import PathFinder
from importlib.util import find_spec, module_from_spec
from pathlib import Path
from threading import RLock
from types import ModuleType, NoneType
from typing import Any, NamedTuple

import numpy as np

SCALARS = {bool: "bool", float: "float64", NoneType: "none", np.random.Generator: "generator"}
NUMBERS = [*(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)), "float32", "float64", "complex64", "complex128"]
CHOSEN = ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES")  # instead of this machine's processor

_lock = RLock()
_loaded: dict[Path, "Loaded | None"] = {}
_environment: dict[str, Any] = {}  # constants of compiled functions by the names of their symbols, which machine code points to
_unpickled: dict[bytes, object] = {}


class Stored(NamedTuple):
    """What a file holds."""

    machine_code: bytes
    needs: tuple[str, ...]  # symbols that it looks up, but for those of other kernels
    environments: dict[str, list[Any]]  # constants by symbol, the kernel's own first
    before: tuple[tuple[str, str, str], ...]  # kernels kept apart that it calls: module, name and types of arguments
    entry: str | None  # the symbol that Python calls; None where only kernels do


class Loaded(NamedTuple):
    """Machine code in memory."""

    entry: Callable[..., Any] | None  # for Python; None where only kernels call it


def key_of(arguments: tuple[Any, ...]) -> Hashable:
    """The types of arguments, quickly: as numba's own calls know them apart."""
    try:
        return _fingerprint()(arguments)
    except NotImplementedError:  # such as for a generator of chance
        return type(arguments), *map(_key, arguments)


def _key(value: Any) -> Any:
    try:
        return _fingerprint()(value)
    except NotImplementedError:
        return (type(value), *map(_key, value)) if isinstance(value, tuple) else type(value)


def names(arguments: Iterable[Any]) -> str | None:
    """The types of arguments as files are named by; None for those that numba has to see."""
    found = [_name(each) for each in arguments]
    return None if None in found else ",".join(map(str, found))


def _name(value: Any) -> str | None:
    of = type(value)
    if of is np.ndarray:
        flags = value.flags
        return array_name(value.dtype, value.ndim, "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A", flags.writeable)
    if issubclass(of, tuple):
        return tuple_name(of, names(value))
    if of is int:
        return "int64" if -(2**63) <= value < 2**63 else None
    return SCALARS.get(of) or (np.dtype(of).name if issubclass(of, np.generic) else None)


def array_name(dtype: np.dtype[Any], ndim: int, layout: str, is_writeable: bool) -> str | None:
    """The type of an array; None where it is of no plain numbers."""
    return f"{dtype.name}[{ndim}{layout}{'w' if is_writeable else ''}]" if dtype.isnative and dtype.kind in "biuf" else None


def tuple_name(of: type, inside: str | None) -> str | None:
    """The type of a tuple."""
    return None if inside is None else f"{'' if of is tuple else f'{of.__module__}.{of.__qualname__}'}({inside})"


def file_name(kernel: str, types: str) -> str:
    """The file of a kernel for arguments of some types, on a processor such as this."""
    return f"{kernel}-{hashlib.sha256(f'{types} {_machine()}'.encode()).hexdigest()[:16]}.code"


@cache
def _machine() -> str:
    from llvmlite import binding as llvm

    known = llvm.get_process_triple(), llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
    return " ".join((*known, *(os.environ.get(name, "") for name in CHOSEN)))


def load(file: Path, function: Callable[..., Any]) -> Loaded | None:
    """The machine code in a file, once for each process; None where there is none that can be loaded.

    Parameters
    ----------
    file
        As `file_name` says, in the folder of the kernel's room.
    function
        The kernel in Python.
    """
    with _lock:
        if file not in _loaded:
            try:
                stored = Stored(*pickle.loads(file.read_bytes()))
                _loaded[file] = _linked(stored, function) if _is_complete(stored) else None
            except (OSError, EOFError, pickle.UnpicklingError, ImportError, AttributeError):  # gone, or half of one
                _loaded[file] = None
        return _loaded[file]


def _is_complete(stored: Stored) -> bool:
    """Whether all that machine code looks up is there, other kernels included: a linker that misses a symbol ends the process."""
    if not all(map(_is_there, stored.needs)):
        return False
    return all(getattr(import_module(module), name).stored(types) for module, name, types in stored.before)


@cache
def _is_there(symbol: str) -> bool:
    """Whether a symbol can be looked up, from now on."""
    from llvmlite import binding as llvm

    if symbol in _symbols():
        llvm.add_symbol(symbol, _symbols()[symbol])
        return True
    return hasattr(ctypes.CDLL(None), symbol)


def _linked(stored: Stored, function: Callable[..., Any]) -> Loaded:
    from llvmlite import binding as llvm

    dynamic = _in_c("numba._dynfunc")
    engine = _engine()
    engine.add_object_file(llvm.ObjectFileRef.from_data(stored.machine_code))
    engine.finalize_object()
    for symbol, constants in stored.environments.items():
        if symbol not in _environment:
            _environment[symbol] = dynamic.Environment({})
            _environment[symbol].consts[:] = constants
        ctypes.c_void_p.from_address(engine.get_global_value_address(symbol)).value = id(_environment[symbol])
    if stored.entry is None:
        return Loaded(None)
    address, own = engine.get_function_address(stored.entry), _environment[next(iter(stored.environments))]
    return Loaded(dynamic.make_function(sys.modules[function.__module__], function.__name__, "", address, own, (engine,)))


@cache
def _engine() -> Any:
    from llvmlite import binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine()
    return llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)


@cache
def _symbols() -> dict[str, int]:
    """What numba gives machine code to look up, by its names there."""
    helpers, functions = _in_c("numba._helperlib").c_helpers, _in_c("numba._dynfunc").c_helpers
    runtime = _in_c("numba.core.runtime._nrt_python").c_helpers
    return {
        **helpers,  # of mathematics
        **{f"numba_{name}": address for name, address in (*helpers.items(), *functions.items())},
        **{name if name.startswith("_") else f"NRT_{name}": address for name, address in runtime.items()},
        **{f"PyExc_{each.__name__}": id(each) for each in vars(builtins).values() if isinstance(each, type)},
        "_Py_NoneStruct": id(None),
        "numba_unpickle": ctypes.cast(_UNPICKLE, ctypes.c_void_p).value or 0,
    }


def _unpickle(data: int, size: int, _: int) -> object:
    """A constant of machine code: a class that it returns, an error that it raises. Numba's own would load numba for it."""
    text = ctypes.string_at(data, size)
    if text not in _unpickled:
        _unpickled[text] = pickle.loads(text)
    return _unpickled[text]


_UNPICKLE = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p)(_unpickle)


@cache
def _fingerprint() -> Callable[[tuple[Any, ...]], bytes]:
    arrays, absent = _in_c("numba._devicearray"), "numba" not in sys.modules
    if absent:  # the module asks its package for the other one when it is loaded
        sys.modules["numba"] = ModuleType("numba")
        sys.modules["numba"]._devicearray = arrays  # type: ignore[attr-defined]
    try:
        dispatcher = _in_c("numba._dispatcher")
    finally:
        if absent:
            del sys.modules["numba"]
    if absent:
        dispatcher.typeof_init(NoneType, dict.fromkeys(NUMBERS, 0))  # numba, once it is loaded, does so again with numbers of its own
    found: Callable[[tuple[Any, ...]], bytes] = dispatcher.compute_fingerprint
    return found


def _in_c(name: str) -> ModuleType:
    """A module of numba's in C, without the packages that it is in. Numba, should it be loaded after all, finds it by its name."""
    if name not in sys.modules:
        package, *inside, _ = name.split(".")
        spec = PathFinder.find_spec(name, [str(place_of(package).joinpath(*inside))])
        if spec is None or spec.loader is None:
            raise ImportError(f"{name} is not there", name=name)
        sys.modules[name] = module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


@cache
def place_of(package: str) -> Path:
    """The folder of an installed package, which is not loaded."""
    spec = find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        raise ImportError(f"{package} is not there", name=package)
    return Path(spec.submodule_search_locations[0])
