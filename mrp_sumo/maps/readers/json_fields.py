"""Members of JSON objects in a map file, with their types checked; a fault names its path, `layouts[0].nodes[2].nodePosition.x`."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from mrp_sumo.errors import MapError, in_one_line, nearest
from mrp_sumo.files.reading import shortened
from mrp_sumo.maps.readers.rmf.level import FARTHEST
from mrp_sumo.maps.yaml_text import Text

NOTHING: Any = object()  # no default: the member must be there


@dataclass(frozen=True)
class Fields:
    """Reads members of the objects of one file. `at` is the path of the object, '' for the document."""

    source: Text

    def fault(self, at: str, message: str) -> MapError:
        """The error to raise about the value at a path."""
        return MapError(f"{shortened(self.source.path)}: {at}: {message}" if at else f"{shortened(self.source.path)}: {message}")

    def mapping(self, value: Any, at: str) -> Mapping[str, Any]:
        if not isinstance(value, Mapping):
            raise self.fault(at, f"found {_shown(value)}, expected an object")
        return value

    def object(self, holder: Mapping[str, Any], key: str, at: str, default: Any = NOTHING) -> Any:
        value = self._given(holder, key, at, default)
        return value if value is default else self.mapping(value, _path(at, key))

    def list(self, holder: Mapping[str, Any], key: str, at: str, default: Any = NOTHING) -> Any:
        """The array under a key."""
        value = self._given(holder, key, at, default)
        if value is not default and not isinstance(value, list):
            raise self.fault(_path(at, key), f"found {_shown(value)}, expected an array")
        return value

    def each(self, holder: Mapping[str, Any], key: str, at: str, default: Any = NOTHING) -> Iterator[tuple[str, Mapping[str, Any]]]:
        """Path and object of each element of the array under a key."""
        for i, element in enumerate(self.list(holder, key, at, default)):
            path = f"{_path(at, key)}[{i}]"
            yield path, self.mapping(element, path)

    def members(self, holder: Mapping[str, Any], key: str, at: str, default: Any = NOTHING) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
        """Name, path and object of each member of the object under a key."""
        for name, member in self.object(holder, key, at, default).items():
            path = f"{_path(at, key)}.{name}"
            yield name, path, self.mapping(member, path)

    def identified(
        self, holder: Mapping[str, Any], key: str, at: str, identifier: str, known: dict[Any, str], default: Any = NOTHING
    ) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
        """Identifier, path and object of each element of the array under a key; `known` gets the paths by identifier, each once."""
        for path, element in self.each(holder, key, at, default):
            name = self.text(element, identifier, path)
            self.unique(known, name, f"{path}.{identifier}")
            known[name] = path
            yield name, path, element

    def text(self, holder: Mapping[str, Any], key: str, at: str, default: Any = NOTHING) -> Any:
        value = self._given(holder, key, at, default)
        if value is not default and not isinstance(value, str):
            raise self.fault(_path(at, key), f"found {_shown(value)}, expected text")
        return value

    def number(self, holder: Mapping[str, Any], key: str, at: str, default: Any = NOTHING) -> Any:
        """The number under a key, finite and not beyond any building."""
        value = self._given(holder, key, at, default)
        return value if value is default else self.finite(value, _path(at, key))

    def finite(self, value: Any, at: str) -> float:
        if type(value) not in (int, float) or not abs(value) < FARTHEST:  # infinite and no number, too
            raise self.fault(at, f"found {_shown(value)}, expected a number")
        return float(value)

    def point(self, value: Any, at: str) -> tuple[float, float]:
        """[x, y], or more."""
        if not isinstance(value, list) or len(value) < 2:
            raise self.fault(at, f"found {_shown(value)}, expected [x, y]")
        return self.finite(value[0], f"{at}[0]"), self.finite(value[1], f"{at}[1]")

    def unique(self, known: Mapping[Any, str], key: Any, at: str) -> None:
        """Refuse an identifier that another object has; `known` are the paths of those before."""
        if key in known:
            raise self.fault(at, f"'{str(key)[:60]}' is taken by {known[key]}")

    def _given(self, holder: Mapping[str, Any], key: str, at: str, default: Any) -> Any:
        value = holder.get(key)
        if value is None:
            if default is not NOTHING:
                return default
            close = nearest(key, [k for k in holder if isinstance(k, str) and len(k) < 60], limit=0)
            raise self.fault(at, f"no '{key}'{close.replace('did you mean', 'there is')}")
        return value


def _path(at: str, key: str) -> str:
    return f"{at}.{key}" if at else key


def _shown(value: Any) -> str:
    if value is None:
        return "nothing"
    if isinstance(value, Mapping | list):
        return "an object" if isinstance(value, Mapping) else f"an array of {len(value)}"
    text = in_one_line(str(value)[:40])
    return f"'{text}'" if isinstance(value, str) else text
