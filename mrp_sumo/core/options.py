"""Options, declared once: frozen dataclasses whose fields say default, bounds and meaning.

From that one declaration come the check of scenario files and of `--set`, the JSON schema, the documentation and the check of values that
Python gives. pydantic reads the metadata of fields by the names of its own arguments; nothing here imports it.
"""

import math
import operator
from collections.abc import Mapping
from dataclasses import field, fields
from typing import Annotated, Any, ClassVar

from annotated_types import Interval

from mrp_sumo.errors import OptionError, nearest

LARGEST = 1e9  # of figures: beyond, sums of them overflow
BOUNDS = {"gt": "above {:g}", "ge": "at least {:g}", "lt": "below {:g}", "le": "at most {:g}"}


INTERVALS = (
    "What these figures may be instead, by name: low and high of each, as 90 % intervals of a calibration (`capacity --error-bands`)."
)


Figure = Annotated[float, Interval(ge=0)]


class Options:
    """Base of declarations. Unknown keys of files are refused, and so is what is out of bounds, wherever it comes from."""

    __pydantic_config__: ClassVar[Mapping[str, Any]] = {"extra": "forbid", "allow_inf_nan": False}

    def __post_init__(self) -> None:
        for each in fields(self):  # type: ignore[arg-type]  # whose subclasses are dataclasses
            value, bounds = getattr(self, each.name), {bound: each.metadata[bound] for bound in BOUNDS if bound in each.metadata}
            if not isinstance(value, float | int):
                continue
            if isinstance(value, float) and abs(value) > LARGEST and math.isfinite(value):
                raise OptionError(f"{each.name} is {value:g}, expected at most {LARGEST:g}")
            if not (math.isfinite(value) and all(getattr(operator, bound)(value, limit) for bound, limit in bounds.items())):
                expected = " and ".join(BOUNDS[bound].format(limit) for bound, limit in bounds.items())
                raise OptionError(f"{each.name} is {value:g}, expected {expected or 'a finite number'}")


def require_intervals(options: Any, more: Mapping[str, float] | None = None) -> None:
    """Refuse intervals of what is no figure, one of its fields or `more`, and such as do not hold it. Raises OptionError."""
    figures = {each.name: getattr(options, each.name) for each in fields(options)}
    figures = {name: value for name, value in figures.items() if isinstance(value, float | int) and not isinstance(value, bool)}
    figures |= more or {}
    for name, (low, high) in options.intervals.items():
        if name not in figures:
            raise OptionError(f"intervals.{name} is no figure that is given here{nearest(name, figures)}")
        if not low <= figures[name] <= high:
            raise OptionError(f"intervals.{name} is {low:g} to {high:g}, expected low and high around {name}, {figures[name]:g}")


def meaning(says: str = "", /, **bounds: float) -> dict[str, Any]:
    """Metadata of a field: a sentence on what it means, and its bounds by `gt`, `ge`, `lt`, `le`."""
    return {"description": says, **bounds} if says else dict(bounds)


def option(default: Any, says: str = "", /, **bounds: float) -> Any:
    """A field with a default and its `meaning`."""
    return field(default=default, metadata=meaning(says, **bounds))
