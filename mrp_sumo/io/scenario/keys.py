"""Keys of scenarios by their dotted names, and what was meant by wrong ones."""

import difflib
from collections.abc import Iterable, Iterator

from mrp_sumo.errors import nearest
from mrp_sumo.io.documents import declared_in, keys_of
from mrp_sumo.io.scenario.model import ScenarioModel


def unknown_key(key: str) -> str:
    """Fault in a dotted key of scenarios, '' if there is none."""
    at: type | None = ScenarioModel
    for i, part in enumerate(parts := key.split(".")):
        if at is None:
            return f"'{'.'.join(parts[:i])}' has no keys"
        if part not in keys_of(at):
            if "parameters" in keys_of(at) and not difflib.get_close_matches(part, keys_of(at)):
                return f"unknown key (did you mean '{'.'.join([*parts[:i], 'parameters', *parts[i:]])}'?)"
            return f"unknown key{nearest_key(key, ('.'.join([*parts[:i], name]) for name in keys_of(at)))}"
        annotation = keys_of(at)[part].annotation
        if str(annotation).startswith("dict"):
            return ""
        at = next(declared_in(annotation), None)
    return ""


def nearest_key(key: str, others: Iterable[str] = ()) -> str:
    """The end of a message about an unknown key: the likeliest meant by its whole name and its last part, else by its last part.

    `others` would have been right, too, and are listed where none is close.
    """
    others = list(others)
    known = [name for name in (*others, *_all_keys(ScenarioModel)) if not key.startswith(f"{name}.")]
    by_last = {_last(name): name for name in reversed(known)}
    by_whole = difflib.get_close_matches(key, known, cutoff=0.75)  # long sections make all their keys alike
    close = [name for name in by_whole if difflib.get_close_matches(_last(key), [_last(name)])] or [
        by_last[name] for name in difflib.get_close_matches(_last(key), by_last, n=1, cutoff=0.75)
    ]
    if close:
        return f" (did you mean '{close[0]}'?)"
    return nearest(_last(key), map(_last, others), limit=20)


def _last(key: str) -> str:
    return key.rpartition(".")[2]


def _all_keys(declared: type, above: str = "") -> Iterator[str]:
    for name, field in keys_of(declared).items():
        yield above + name
        if isinstance(field.annotation, type):
            for inner in declared_in(field.annotation):
                yield from _all_keys(inner, f"{above}{name}.")
