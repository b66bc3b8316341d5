"""Words that the code does without: the private dialect in names, and docstrings that do not name the thing first.

    .venv/bin/python tools/words.py            # counts by room; exit code 1 where there are more than MOST
    .venv/bin/python tools/words.py ROOM ...   # each place in these rooms, such as mrp_sumo/traffic

A count may fall and not rise above its entry in MOST, which `tests/test_words.py` holds: who lowers a count lowers the entry, too.
"""

import ast
import re
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
DIALECT = {"found", "way", "around", "news", "kept", "given", "asked", "told", "moment"}
QUESTION = re.compile(r"(?:What|Who|Whom|Whose|Whether|How|Where|When|Which)\b")
MOST = {"names": 0, "docstrings": 0}


def main() -> int:
    """Print counts or places."""
    places = [place for path in sources() for place in faults_of(path)]
    if rooms := sys.argv[1:]:
        print(*(f"{path}:{line}: {kind}: {word}" for path, line, kind, word in places if path.startswith(tuple(rooms))), sep="\n")
        return 0
    for kind, most in MOST.items():
        rooms_of = Counter(str(Path(path).parent) for path, _, one, _ in places if one == kind)
        print(f"{kind}: {rooms_of.total()}, at most {most}")
        print(*(f"  {count:4} {room}" for room, count in rooms_of.most_common()), sep="\n")
    return int(any(count > MOST[kind] for kind, count in counts().items()))


def counts() -> dict[str, int]:
    """How often each kind of fault occurs in the program and its planners."""
    kinds = Counter(kind for path in sources() for _, _, kind, _ in faults_of(path))
    return {kind: kinds[kind] for kind in MOST}


def sources() -> list[Path]:
    """The Python files of the program and its planners."""
    return sorted(path for room in ("mrp_sumo", "planners") for path in (PROJECT / room).rglob("*.py"))


def faults_of(path: Path) -> Iterator[tuple[str, int, str, str]]:
    """Faults of a file: path, line, kind, word."""
    name = path.relative_to(PROJECT).as_posix() if path.is_relative_to(PROJECT) else path.name
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        word = named(node)
        if word in DIALECT:
            yield name, node.lineno, "names", word
        if (isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_")) or isinstance(node, ast.Module):
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
