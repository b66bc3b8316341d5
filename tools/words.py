"""Words that the code does without: the private dialect in names, and docstrings that do not name the thing first.

    .venv/bin/python tools/words.py            # each place; exit code 1 where there is one

`tests/test_words.py` holds it.
"""

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
DIALECT = {"found", "way", "around", "news", "kept", "given", "asked", "told", "moment"}
QUESTION = re.compile(r"(?:What|Who|Whom|Whose|Whether|How|Where|When|Which)\b")
ROOMS = {"mrp_sumo": True, "planners": True, "tools": False, "tests": False}  # whether docstrings are looked at, too


def main() -> int:
    """Print the places."""
    places = [place for room in ROOMS for path in sources(room) for place in faults_of(path)]
    print(*(f"{path}:{line}: {kind}: {word}" for path, line, kind, word in places), sep="\n", end="\n" if places else "")
    return int(bool(places))


def sources(room: str) -> list[Path]:
    """The Python files of a room."""
    return sorted((PROJECT / room).rglob("*.py"))


def faults_of(path: Path) -> Iterator[tuple[str, int, str, str]]:
    """Faults of a file: path, line, kind, word."""
    name = path.relative_to(PROJECT).as_posix() if path.is_relative_to(PROJECT) else path.name
    with_docstrings = ROOMS.get(name.partition("/")[0], True)
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        word = named(node)
        if word in DIALECT:
            yield name, node.lineno, "names", word
        if with_docstrings and (isinstance(node, ast.Module) or (isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name[0] != "_")):
            text = ast.get_docstring(node) or ""
            if match := QUESTION.match(text):
                yield name, getattr(node, "lineno", 1), "docstrings", match[0]


def named(node: ast.AST) -> str | None:
    """The name that a node binds: of a variable that is assigned, a parameter, a function, a class or a field."""
    if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
        return node.id
    if isinstance(node, ast.arg):
        return node.arg
    return node.name if isinstance(node, ast.FunctionDef | ast.ClassDef) else None


if __name__ == "__main__":
    sys.exit(main())
