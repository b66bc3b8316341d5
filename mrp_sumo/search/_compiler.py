"""What kernels need of numba: compiling them, and storing what is compiled. Loaded when there is something to compile.

A compiled kernel is stored twice: as numba stores it, for kernels that call it, and as `_stored` loads it, for calls from Python.
"""

import pickle
import re
from contextlib import suppress
from functools import cache, partial
from importlib import import_module

from mrp_sumo.core.imports import without

with without("scipy", "coverage"):  # for BLAS, which no kernel calls, and for lines that it cannot see
    import numba
from llvmlite.binding import parse_assembly, parse_bitcode
from numba.core import event, types
from numba.core.caching import Cache, CompileResultCacheImpl, _CacheLocator
from numba.core.codegen import JITCodeLibrary
from numba.core.funcdesc import default_mangler
from numba.core.runtime import rtsys
from numba.np.numpy_support import as_dtype

from mrp_sumo.search import _stored

ENVIRONMENT = "_ZN08NumbaEnv"  # what the symbols of compiled functions' constants begin with

_LOOKED_UP = re.compile(rb"_ZN(?:7cpython|08NumbaEnv)[^\0]+")  # symbols in machine code: its entry, and the constants of its functions
_apart: set[str] = set()  # full names of kernels whose machine code their callers share


def dispatcher_of(kernel, before):
    """What compiles a kernel for the types of arguments that it is called with, or loads it for a caller to be compiled.

    Parameters
    ----------
    kernel
        A `Kernel`.
    before
        Called before any kernel is compiled.
    """
    _listen(before)
    function = kernel.py_func
    dispatcher = numba.njit(**kernel.targetoptions, no_cpython_wrapper=kernel.is_inner, no_cfunc_wrapper=True)(function)
    if kernel.apart:
        _apart.add(f"{function.__module__}.{function.__qualname__}")
    dispatcher.add_overload = partial(_add_overload, dispatcher, kernel)
    if kernel.folder:
        dispatcher._cache = _KernelCache(kernel)
    dispatcher.get_call_template = partial(_template_of_few_types, dispatcher.get_call_template)
    return dispatcher


@cache
def _listen(before):
    event.register("numba:compile", _Show(before))


class _Show(event.Listener):
    def __init__(self, before):
        self._before = before

    def on_start(self, event):
        self._before()

    def on_end(self, event):
        """It is not stored yet: that is for the next to show."""


def _template_of_few_types(template_of, args, kws):
    return template_of([_widened(a) for a in args], {key: _widened(a) for key, a in kws.items()})


def _widened(argument):
    argument = types.unliteral(argument)
    return types.int64 if argument == types.int32 else argument


def _add_overload(dispatcher, kernel, found):
    arguments = tuple(found.signature.args)
    if kernel.apart:
        found.library.apart = (kernel.py_func.__module__, kernel.py_func.__qualname__, arguments)
    if kernel.is_inner:
        dispatcher.overloads[arguments] = found  # not for calls from Python, which would look for their way in
    else:
        type(dispatcher).add_overload(dispatcher, found)


def _mangled(name, types, *, abi_tags=(), uid=None):
    """As numba's, but the same in all processes for a kernel that others call by its name: there is no other of its name."""
    return default_mangler(name, types, abi_tags=abi_tags, uid=None if name.removeprefix(".NumbaEnv.") in _apart else uid)


class _Locator(_CacheLocator):
    """Tells numba the folder."""

    def __init__(self, folder):
        self._folder = folder

    @classmethod
    def from_function(cls, py_func, py_file):
        raise NotImplementedError

    def get_cache_path(self):
        return str(self._folder)

    def get_source_stamp(self):
        return ""  # the folder's name is the stamp

    def get_disambiguator(self):
        return ""


class _KernelCacheImpl(CompileResultCacheImpl):
    def __init__(self, kernel):
        self._locator, self._filename_base, self._lineno = _Locator(kernel.folder), kernel.file_name, 0


class _KernelCache(Cache):
    _impl_class = _KernelCacheImpl

    def __init__(self, kernel):
        super().__init__(kernel)
        self._kernel, self._py_func = kernel, kernel.py_func

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

    def save_overload(self, sig, data):
        """As numba's, but for `_stored` first: what is stored for numba alone would never be stored again."""
        with suppress(OSError):  # a full disk: it is compiled again
            if found := _to_store(self._kernel, data):
                types, stored = found
                path = self._kernel.folder / _stored.file_name(self._kernel.file_name, types)
                with self._cache_file._open_for_write(str(path)) as file:
                    pickle.dump(tuple(stored), file)
        super().save_overload(sig, data)


def _to_store(kernel, compiled):
    """Types of arguments, and what `_stored` needs; None where only kernels call it, and for types that only numba knows."""
    library = compiled.library
    if (kernel.is_inner and not kernel.apart) or library.has_dynamic_globals:
        return None
    library._ensure_finalized()
    names = _names(compiled.signature.args)
    before = tuple((module, name, _names(arguments)) for module, name, arguments in library._callees_apart())
    own = compiled.environment
    constants = {each.env_name: list(each.consts) for each in (own, *compiled._find_referenced_environments())}
    module = library._final_module
    declared = [each.name for each in (*module.functions, *module.global_variables) if each.is_declaration]
    needs = tuple(name for name in declared if not name.startswith(("llvm.", "_ZN")))
    entry = None if kernel.is_inner else compiled.fndesc.llvm_cpython_wrapper_name
    if None in (names, *(arguments for *_, arguments in before)) or b"numba" in pickle.dumps(list(constants.values())):
        return None
    return names, _stored.Stored(library._get_compiled_object(), needs, constants, before, entry)


def _names(of):
    """The types of arguments as `_stored.names` has them."""
    names = [_name(each) for each in of]
    return None if None in names else ",".join(names)


def _name(of):
    match of:
        case types.Array():
            return _stored.array_name(as_dtype(of.dtype), of.ndim, of.layout, of.mutable)
        case types.BaseTuple():
            return _stored.tuple_name(getattr(of, "instance_class", tuple), _names(of.types))
        case types.Boolean() | types.Integer() | types.Float():
            return as_dtype(of).name
        case types.NoneType():
            return "none"
        case types.NumPyRandomGeneratorType():
            return "generator"
    return None


class _Library(JITCodeLibrary):
    """Machine code; what a caller of it is compiled from is parsed when there is a caller to compile, for it takes longer than loading.

    A kernel that is kept apart gives its callers nothing to be compiled from. They hold its name, which the linker finds in the machine
    code that is loaded, so it is loaded before them.
    """

    apart = None  # module, name and argument types of the kernel, if it is kept apart
    _bitcode = None
    _loaded_before = ()

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
            getattr(import_module(module), kernel_name).dispatcher.compile(arguments)
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
