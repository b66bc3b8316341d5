"""Measures of how simple the sources are, counted by reading them: sizes, names, and what depends on what.

    .venv/bin/python tools/measures.py             # the table, for this checkout
    .venv/bin/python tools/measures.py CHECKOUT    # side by side with another checkout, which stands first
    .venv/bin/python tools/measures.py --places M  # each place of a measure, such as `arguments`

They are measures to steer by, not gates: where a merge makes something worse to read, leave it. Not counted here, since they are of
concepts: searches, trees, loops that drive the controller.
"""

import argparse
import ast
import re
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
MAIN_PATH = {  # the calls of docs/architecture.md, module -> function
    "mrp_sumo/io/scenario/read.py": "read_scenario",
    "mrp_sumo/experiments/staging/set_up.py": "set_up",
    "mrp_sumo/experiments/solve.py": "solve",
    "mrp_sumo/drive/loop.py": "simulate",
    "mrp_sumo/metrics/audit.py": "audit",
    "mrp_sumo/metrics/evaluate.py": "evaluate",
    "mrp_sumo/io/run_folder.py": "write_run",
}
MOST_ARGUMENTS = 7
SMALL_FILE = 80
STATE = "mrp_sumo/drive/state.py"
Function = ast.FunctionDef | ast.AsyncFunctionDef
Trees = dict[str, ast.Module]  # path below the checkout -> its source


def main() -> int:
    """Print the table or places."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", nargs="?", type=Path, help="another checkout")
    parser.add_argument("--places", choices=MEASURES, metavar="MEASURE", help=f"each place of a measure: {', '.join(MEASURES)}")
    options = parser.parse_args()
    project = options.checkout or PROJECT
    if options.places:
        print(*MEASURES[options.places][1](sources(project)), sep="\n")
        return 0
    columns = [sources(one) for one in ([options.checkout] if options.checkout else []) + [PROJECT]]
    print(f"| measure | {'there | ' if options.checkout else ''}here |\n|---|{'---|' * len(columns)}")
    for title, places in MEASURES.values():
        print(f"| {title} | {' | '.join(f'{len(places(trees)):,}' for trees in columns)} |")
    return 0


def sources(project: Path) -> Trees:
    """The Python files of the program and its planners."""
    files = sorted(path for room in ("mrp_sumo", "planners") for path in (project / room).rglob("*.py") if "__pycache__" not in path.parts)
    return {path.relative_to(project).as_posix(): ast.parse(path.read_text(encoding="utf-8")) for path in files}


def lines(trees: Trees) -> range:
    """Lines of all files, by their syntax: what follows the last statement is not counted."""
    return range(sum(max((getattr(node, "end_lineno", 0) for node in tree.body), default=0) for tree in trees.values()))


def main_path_types(trees: Trees) -> list[str]:
    """Types that the signatures of the main path name, and those that the fields of these types name, on to the last."""
    classes = {node.name: node for tree in trees.values() for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}
    aliases = {  # names of annotations: `Asked = Callable[[View], ...]`
        statement.targets[0].id: statement.value
        for tree in trees.values()
        for statement in tree.body
        if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name)
    }
    signatures = (function for path, name in MAIN_PATH.items() for function in functions(trees[path]) if function.name == name)
    to_do = [name for function in signatures for part in annotations(function) for name in names_in(part)]
    seen: set[str] = set()
    while to_do:
        name = to_do.pop()
        if name not in seen and name in classes:
            seen.add(name)
            to_do += [one for field in classes[name].body if isinstance(field, ast.AnnAssign) for one in names_in(field.annotation)]
        elif name not in seen and name in aliases:
            to_do += names_in(aliases.pop(name))
    return sorted(seen)


def annotations(function: Function) -> Iterator[ast.expr]:
    """The annotations of a signature."""
    yield from (one.annotation for one in parameters(function) if one.annotation)
    if function.returns:
        yield function.returns


def names_in(annotation: ast.expr) -> list[str]:
    """The names in an annotation, those in quotes too."""
    parts = list(ast.walk(annotation))
    quoted = [re.findall(r"\w+", node.value) for node in parts if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    return [*(node.id for node in parts if isinstance(node, ast.Name)), *(name for names in quoted for name in names)]


def class_names(trees: Trees) -> list[str]:
    """Names that several classes bear, with their files."""
    places = defaultdict(list)
    for path, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(path)
    return [f"{name}: {', '.join(paths)}" for name, paths in sorted(places.items()) if len(paths) > 1]


def arguments(trees: Trees) -> list[str]:
    """Functions with more than seven arguments, `self` among them."""
    return [
        f"{path}:{function.lineno}: {function.name}: {len(list(parameters(function)))}"
        for path, tree in trees.items()
        for function in functions(tree)
        if len(list(parameters(function))) > MOST_ARGUMENTS
    ]


def functions(tree: ast.Module) -> Iterator[Function]:
    """All functions of a file."""
    return (node for node in ast.walk(tree) if isinstance(node, Function))


def parameters(function: Function) -> Iterator[ast.arg]:
    """All parameters of a function."""
    of = function.args
    yield from (one for one in (*of.posonlyargs, *of.args, of.vararg, *of.kwonlyargs, of.kwarg) if one is not None)


def writers(trees: Trees) -> list[str]:
    """Arrays of the state of a run that several files write to, as `record.field[...] = ...` or by a local name of the field."""
    fields = {
        (node.name.lower(), field.target.id)
        for node in trees[STATE].body
        if isinstance(node, ast.ClassDef)
        for field in node.body
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and "Array" in ast.unparse(field.annotation)
    }
    files = defaultdict(set)
    for path, tree in trees.items():
        for function in functions(tree) if path.startswith("mrp_sumo/drive/") else ():
            local = dict(renamed(function))
            for node in ast.walk(function):
                if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store):
                    array = local.get(node.value.id) if isinstance(node.value, ast.Name) else field_of(node.value)
                    if array in fields:
                        files[array].add(path)
    return [f"{'.'.join(array)}: {', '.join(sorted(paths))}" for array, paths in sorted(files.items()) if len(paths) > 1]


def renamed(function: Function) -> Iterator[tuple[str, tuple[str, str]]]:
    """Local names of fields of records, such as `a, b = record.a, record.b`."""
    for node in ast.walk(function):
        if isinstance(node, ast.Assign):
            for target in node.targets:
                pairs = (
                    zip(target.elts, node.value.elts)
                    if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
                    else [(target, node.value)]
                )
                yield from ((one.id, array) for one, value in pairs if isinstance(one, ast.Name) and (array := field_of(value)))


def field_of(node: ast.expr) -> tuple[str, str] | None:
    """Record and field of `record.field` or `something.record.field`."""
    if not isinstance(node, ast.Attribute):
        return None
    record = node.value
    owner = record.attr if isinstance(record, ast.Attribute) else record.id if isinstance(record, ast.Name) else ""
    return owner.lstrip("_"), node.attr


def private_names(trees: Trees) -> list[str]:
    """Names with one underscore in front that are imported or looked up in something, and that no source of ours defines.

    Of what is looked up in another object than `self`, a source in the same folder has to.
    """
    documented = {"_replace", "_asdict", "_fields", "_make", "_exit"}  # of named tuples and `os`
    ours: dict[str, set[str]] = defaultdict(set)
    for path, tree in trees.items():
        ours[path.rpartition("/")[0]].update(defined(tree))
    anywhere = documented.union(*ours.values())
    return [
        f"{path}:{line}: {name}"
        for path, tree in trees.items()
        for line, name, of_self in looked_up(tree)
        if is_private(name) and name not in (anywhere if of_self else ours[path.rpartition("/")[0]] | documented)
    ]


def defined(tree: ast.Module) -> Iterator[str]:
    """Functions, classes, variables and attributes that a file defines."""
    for node in ast.walk(tree):
        if isinstance(node, Function | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id


def looked_up(tree: ast.Module) -> Iterator[tuple[int, str, bool]]:
    """Lines and names of attributes, and of what is imported from other libraries; True where `self` has it."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            yield node.lineno, node.attr, isinstance(node.value, ast.Name) and node.value.id == "self"
        elif isinstance(node, ast.Import):
            yield from ((node.lineno, part, False) for alias in node.names for part in alias.name.split("."))
        elif isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] not in ("mrp_sumo", "planners"):
            yield from ((node.lineno, part, False) for part in [*node.module.split("."), *(alias.name for alias in node.names)])


def is_private(name: str) -> bool:
    """Whether a name begins with one underscore."""
    return name.startswith("_") and not name.startswith("__")


def pulled_in(planner: str) -> Callable[[Trees], list[str]]:
    """Counts the files of `planners` that a planner's file imports, itself among them."""

    def files(trees: Trees) -> list[str]:
        to_do, seen = [planner], set()
        while to_do:
            path = to_do.pop()
            if path in trees and path not in seen:
                seen.add(path)
                to_do += [f"{one.replace('.', '/')}.py" for one in imported(trees[path]) if one.startswith("planners")]
        return sorted(seen)

    return files


def imported(tree: ast.Module) -> Iterator[str]:
    """Modules that a file imports, wherever; names imported from one may be such."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (node.module, *(f"{node.module}.{alias.name}" for alias in node.names))


def small_files(trees: Trees) -> list[str]:
    """Short files that one other file imports."""
    callers = defaultdict(set)
    for path, tree in trees.items():
        for module in imported(tree):
            callers[f"{module.replace('.', '/')}.py"].add(path)
    return [
        f"{path}: {num}: {', '.join(callers[path])}"
        for path, tree in trees.items()
        if (num := len(lines({path: tree}))) < SMALL_FILE and len(callers[path]) == 1
    ]


def long_functions(trees: Trees) -> list[str]:
    """Functions of more than sixty lines."""
    return [
        f"{path}:{one.lineno}: {one.name}: {(one.end_lineno or 0) - one.lineno + 1}"
        for path, tree in trees.items()
        for one in functions(tree)
        if (one.end_lineno or 0) - one.lineno >= 60
    ]


MEASURES: dict[str, tuple[str, Callable[[Trees], range | list[str]]]] = {
    "lines": ("lines in `mrp_sumo` and `planners`", lines),
    "types": ("types that the seven calls of the main path name, with those of their fields", main_path_types),
    "classes": ("class names with two meanings", class_names),
    "arguments": (f"functions with more than {MOST_ARGUMENTS} arguments", arguments),
    "writers": ("arrays of the state with several writers", writers),
    "private": ("private names of other libraries", private_names),
    "pibt": ("planner files that `pibt` pulls in", pulled_in("planners/configuration/pibt.py")),
    "lacam": ("planner files that `lacam` pulls in", pulled_in("planners/configuration/lacam.py")),
    "files": ("Python files", lambda trees: list(trees)),
    "small": (f"files below {SMALL_FILE} lines with one caller", small_files),
    "long": ("functions above 60 lines", long_functions),
}


if __name__ == "__main__":
    sys.exit(main())
