"""Plug-ins' files: where they are, what they are made of, and the one place where they are loaded.

`./mine.py:OneByOne` is the class or function of a file. Files are read as text to find names and imports; only `load` executes them.
"""

import ast
import hashlib
import importlib
import importlib.util
import re
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from mrp_sumo.errors import MrpSumoError, PlugInError, ScenarioError, nearest
from mrp_sumo.plugins.face import place_of, shown
from mrp_sumo.plugins.limit import Overran, limited
from mrp_sumo.plugins.trust import Program, require_trusted

_IN_FILE = re.compile(r"(.+\.py):([A-Za-z_]\w*)")
_INSTALLED = {"site-packages", "dist-packages"}
_OURS = {"mrp_sumo", "planners"}  # part of the version of the code
_loaded: dict[Path, tuple[str, ModuleType]] = {}  # files with the hash of what was loaded


@dataclass(frozen=True)
class Source:
    """The place of a plug-in."""

    name: str  # as the scenario says
    module: str  # '' for a file
    attribute: str
    path: Path | None  # of the module or file; None for ours, and where the module cannot be found
    ours: bool
    package: str = ""  # name and version of the installed package that brings it


def definition(source: Source) -> str:
    """`file:line` of the class or function, read from the text."""
    if source.path is None:
        return source.module
    for node in ast.walk(_tree(source.path)):
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and node.name == source.attribute:
            return f"{shown(source.path)}:{node.lineno}"
    return shown(source.path)


def place_in_file(name: str) -> tuple[str, str] | None:
    """File and attribute of `mine.py:OneByOne`; None for a plain name."""
    match = _IN_FILE.fullmatch(name)
    return (match[1], match[2]) if match else None


def short_name(name: str) -> str:
    """The name of a plug-in for tables and pages: the stem of its file, `mine` for `./mine.py:OneByOne`; a plain name as it is."""
    place = place_in_file(name)
    return Path(place[0]).stem if place else name


def resolved(name: str, beside: Path) -> str:
    """A place in a file with its path made absolute; a plain name as it is."""
    place = place_in_file(name)
    return f"{(beside / place[0]).resolve()}:{place[1]}" if place else name


def source_in_file(name: str, beside: Path) -> Source:
    """The source of a place in a file, which is read but not executed.

    Raises ScenarioError when there is no such file, it is not Python, or has no such name (with the nearest).
    """
    place = place_in_file(name)
    assert place is not None
    path = (beside / place[0]).resolve()
    if not path.is_file():
        known = nearest(path.name, sorted(p.name for p in path.parent.glob("*.py")) if path.parent.is_dir() else ())
        raise ScenarioError(f"'{name}': no such file: {shown(path)}{known}")
    known_names = _names(_tree(path))
    if place[1] not in known_names and "*" not in known_names:
        raise ScenarioError(f"'{name}': {shown(path)} has no '{place[1]}'{nearest(place[1], sorted(known_names))}")
    return Source(name, "", place[1], path, ours=False)


def source_in_module(name: str, place: str, *, ours: bool, package: str = "") -> Source:
    """The source of 'module:attribute' of an installed package."""
    module, _, attribute = place.partition(":")
    return Source(name, module, attribute, None if ours else _module_path(module), ours, package)


def program_of(name: str, beside: Path) -> Program | None:
    """The program behind the name of a plug-in; None for a plain name, which is ours or of an installed package."""
    place = place_in_file(name)
    return Program((beside / place[0]).resolve()) if place else None


def require_source(source: Source) -> None:
    """Refuse a plug-in's file that is not trusted; what is installed is. Raises MrpSumoError."""
    if source.path and not source.module:
        require_trusted(Program(source.path))


def load(source: Source) -> Any:
    """Load a plug-in. Nothing else in the program executes a plug-in's file.

    Raises MrpSumoError for a file that is not trusted, and PlugInError for whatever goes wrong in the file, with its line.
    """
    require_source(source)
    with calling(source):
        module = importlib.import_module(source.module) if source.module else _file_module(source)
    try:
        return getattr(module, source.attribute)
    except AttributeError:
        where = shown(source.path) if source.path else source.module
        raise PlugInError(f"{where} has no '{source.attribute}'{nearest(source.attribute, _public(module))}") from None


@contextmanager
def calling(source: Source, target: Any = None, *passed: type[BaseException]) -> Iterator[None]:
    """Code of a plug-in within: it is interrupted as by `limited`, and what it raises is as `blamed` has it, but for what is passed on."""
    try:
        with limited():
            yield
    except BaseException as error:
        if isinstance(error, (KeyboardInterrupt, *passed)):
            raise
        raise blamed(error, source, target) from error


def blamed(error: BaseException, source: Source, target: Any = None) -> PlugInError:
    """An exception in a plug-in's code as one line that names the last of its own lines, or `target` where none was under way."""
    details = "".join(traceback.format_exception(error))
    if isinstance(error, PlugInError):
        return PlugInError(str(error), error.details or details)
    said = " ".join(str(error).split())[:300]
    if isinstance(error, SystemExit):
        said = f"ended the program (SystemExit: {error.code})"
    elif not isinstance(error, MrpSumoError | Overran):
        said = f"{type(error).__name__}: {said}" if said else type(error).__name__
    if isinstance(error, SyntaxError) and error.filename and _is_own(Path(error.filename), source):
        return PlugInError(f"{shown(Path(error.filename))}:{error.lineno}: {type(error).__name__}: {error.msg}", details)
    where = place_of(target) if target is not None else shown(source.path) if source.path else source.module
    if own := [f for f in traceback.extract_tb(error.__traceback__) if _is_own(Path(f.filename), source)]:
        where = f"{shown(Path(own[-1].filename))}:{own[-1].lineno}" + ("" if own[-1].name == "<module>" else f": in {own[-1].name}")
    return PlugInError(f"{where}: {said}", details)


def digest(source: Source) -> str:
    """Hash of a plug-in's source: its file and what that imports, directly or not, from its own package or folder.

    The same on every machine. Nothing is executed: imports are read from the text, wherever they stand in it.
    """
    if source.path is None:
        return hashlib.sha256(f"{source.package} {source.module}:{source.attribute}".encode()).hexdigest()
    root, files = _top(source.path), sorted(_closure(source.path))
    parts = [f"{path.relative_to(root).as_posix()} {hashlib.sha256(path.read_bytes()).hexdigest()}" for path in files]
    return hashlib.sha256("\n".join([source.package, source.attribute, *parts]).encode()).hexdigest()


def _file_module(source: Source) -> ModuleType:
    """The module of a file, executed again when the file has changed. What it imports may stand beside it."""
    path = source.path
    assert path is not None
    content = path.read_bytes()
    mark = hashlib.sha256(content).hexdigest()
    if path in _loaded and _loaded[path][0] == mark:
        return _loaded[path][1]
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))  # last, so that a file there cannot stand in for a library of ours
    name = f"mrp_sumo_plugin_{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    module = ModuleType(name)
    module.__file__ = str(path)
    sys.modules[name] = module  # dataclasses look their module up
    writes, sys.dont_write_bytecode = sys.dont_write_bytecode, True  # bytecode knows a change by whole seconds only
    try:
        exec(compile(content, str(path), "exec"), module.__dict__)
    except BaseException:
        del sys.modules[name]
        raise
    finally:
        sys.dont_write_bytecode = writes
    _loaded[path] = (mark, module)
    return module


def _tree(path: Path) -> ast.Module:
    try:
        return ast.parse(path.read_bytes(), str(path))
    except SyntaxError as error:
        raise ScenarioError(f"{shown(path)}:{error.lineno}: {type(error).__name__}: {error.msg}") from None
    except (ValueError, OSError) as error:
        raise ScenarioError(f"{shown(path)}: cannot be read as Python: {error}") from None


def _names(tree: ast.Module) -> set[str]:
    """What a module defines at its top level, '*' where it imports all of another's."""
    names: set[str] = set()
    for node in ast.walk(tree):  # within `if` and `try` too
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            names.add(node.name)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names |= {alias.asname or alias.name for alias in node.names}
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
    return names


def _public(module: ModuleType) -> list[str]:
    return sorted(name for name in vars(module) if not name.startswith("_"))


def _module_path(module: str) -> Path | None:
    top, *rest = module.split(".")
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError):
        return None
    if spec is None:
        return None
    if not rest:
        return Path(spec.origin) if spec.origin and spec.origin.endswith(".py") else None
    return next(filter(None, (_in_folder(Path(folder), rest) for folder in spec.submodule_search_locations or ())), None)


def _in_folder(folder: Path, parts: list[str]) -> Path | None:
    places = (folder.joinpath(*parts).with_suffix(".py"), folder.joinpath(*parts, "__init__.py"))
    return next((path.resolve() for path in places if path.is_file()), None)


def _top(path: Path) -> Path:
    """The folder of a lone file; the parent of the top-level package of one that is in a package."""
    folder = path.parent
    while (folder / "__init__.py").is_file():
        folder = folder.parent
    return folder


def _is_own(path: Path, source: Source) -> bool:
    """True if a file is the plug-in's, or of its package or folder."""
    if source.path is None or not path.is_absolute():
        return False
    if path == source.path:
        return True
    top = _top(source.path)
    lone = top == source.path.parent
    folder = top if lone else top / source.path.relative_to(top).parts[0]
    if not path.is_relative_to(folder) or (lone and folder.name in _INSTALLED):
        return False
    return not (set(path.relative_to(folder).parts) & (_INSTALLED | _OURS))


def _closure(path: Path) -> set[Path]:
    """A file and what it imports from its own package or folder, directly or not."""
    files, todo = {path}, [path]
    while todo:
        new = set(_imported(todo.pop())) - files
        files |= new
        todo += new
    return files


def _imported(path: Path) -> Iterator[Path]:
    """The files of its own package or folder that a file imports; packages' `__init__.py` on the way included."""
    try:
        tree = ast.parse(path.read_bytes())
    except (SyntaxError, ValueError, OSError):
        return
    top = _top(path)
    lone = top == path.parent
    package = path.relative_to(top).parts[:-1]
    for node in ast.walk(tree):
        dotted: list[tuple[str, ...]] = []
        if isinstance(node, ast.Import):
            dotted = [tuple(alias.name.split(".")) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            begin = package[: len(package) - node.level + 1] if node.level else ()
            begin += tuple(node.module.split(".")) if node.module else ()
            dotted = [begin, *((*begin, alias.name) for alias in node.names)]
        for name in dotted:
            if not name or name[0] in _OURS or (top.name in _INSTALLED and (lone or name[0] != package[0])):
                continue
            places = (_in_folder(folder, list(name[:end])) for end in range(1, len(name) + 1) for folder in {top, path.parent})
            yield from filter(None, places)
