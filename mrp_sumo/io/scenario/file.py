"""A checked scenario with where it came from, so that messages name file, line and key; and where scenarios are found."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mrp_sumo.errors import MrpSumoError, PlugInError, ScenarioError, nearest
from mrp_sumo.files.reading import require_regular, shortened
from mrp_sumo.io.documents import Document, Place
from mrp_sumo.io.scenario.model import ScenarioModel
from mrp_sumo.maps.catalogue import bundled_folder


@dataclass(frozen=True)
class ScenarioFile:
    """A checked scenario, and where its values come from, for messages about them."""

    scenario: ScenarioModel
    document: Document
    options: Mapping[Place, str]  # command line options by the place they stand for

    def at(self, *place: str | int) -> str:
        """`file:line: key` of a place, or the command line option that set it or something above it, or those that set something in it."""
        for end in range(len(place), 0, -1):
            if option := self.options.get(place[:end]):
                return option
        inside = dict.fromkeys(option for set_place, option in self.options.items() if set_place[: len(place)] == place)
        return ", ".join(inside) or self.document.at(place)

    @contextmanager
    def located(self, *place: str | int) -> Iterator[None]:
        """Refusals within the block name file, line and key of a place: what is made of its value finds the fault, and knows no file."""
        try:
            yield
        except PlugInError:  # names its own file and line
            raise
        except MrpSumoError as error:
            raise type(error)(*(f"{self.at(*place)}: {line}" for line in str(error).splitlines())) from None

    def having(self, **sections: Any) -> "ScenarioFile":
        """The scenario with other sections, which are not checked again."""
        return replace(self, scenario=self.scenario.model_copy(update=sections))

    @property
    def folder(self) -> Path:
        """Folder where relative paths begin."""
        return self.document.path.parent


def find_scenario(name_or_path: str) -> Path:
    """The file of a scenario: a path, or the name of a bundled one (`office_9`, `suites/...`).

    Raises ScenarioError when there is no such file, with the nearest one.
    """
    path, bundled = Path(name_or_path), bundled_folder("scenarios")
    named = bundled / (name_or_path if name_or_path.endswith(".yaml") else f"{name_or_path}.yaml")
    for file in (path, named):
        if os.path.isfile(file):  # noqa: PTH113  False for names that no system takes, too
            return file
    if os.path.isdir(path) and len(inside := [*path.glob("*.yaml")]) == 1:  # noqa: PTH112  likewise
        raise ScenarioError(f"{shortened(path)} is a folder, expected a file (did you mean '{shortened(inside[0])}'?)")
    if os.path.lexists(path):
        require_regular(path, error=ScenarioError)
    names = sorted(p.stem for p in bundled.glob("*.yaml"))
    beside = sorted(p.name for p in path.parent.glob("*") if p.is_file()) if path.suffix and path.stem not in names else []
    known = nearest(path.name, beside, limit=0) or nearest(path.stem if path.stem in names else path.name, names, limit=10)
    raise ScenarioError(f"{shortened(path)}: no such file{known}")
