"""Planners and assigners by name, with their parameters; see `mrp_sumo.plugins.registry` for where they are found.

Ours are made in this process, those from outside in one of their own, when they are first used.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

from mrp_sumo.planning.outside import OutsideAssigner, OutsidePlanner
from mrp_sumo.planning.protocol import Assigner, Planner
from mrp_sumo.plugins import registry
from mrp_sumo.plugins.parameters import parameters_of


def planner(name: str, parameters: Mapping[str, Any], beside: Path | None = None) -> Planner:
    """The planner of this name, as registered or `FILE.py:CLASS` relative to the folder `beside`.

    Raises ScenarioError for an unknown name or parameter (with the nearest right one), or a value that does not fit. What only the code of
    a plug-in from outside can tell is raised by its `prepare`.
    """
    source = registry.find("planners", name, beside)
    return cast(Planner, registry.make("planners", name, parameters)) if source.ours else OutsidePlanner(source, parameters)


def assigner(name: str, parameters: Mapping[str, Any], beside: Path | None = None) -> Assigner:
    """The assigner of this name; as `planner`."""
    source = registry.find("assigners", name, beside)
    return cast(Assigner, registry.make("assigners", name, parameters)) if source.ours else OutsideAssigner(source, parameters)


def parameter_names(name: str) -> tuple[str, ...] | None:
    """The parameters of a planner of ours; None for one from outside, which would have to be loaded.

    Raises ScenarioError for an unknown name.
    """
    if not registry.find("planners", name).ours:
        return None
    return tuple(parameter.name for parameter in parameters_of(planner_class(name)))


def planner_names() -> tuple[str, ...]:
    """All registered planners, sorted."""
    return registry.names("planners")


def planners_that(support: str) -> str:
    """The planners of ours that support something, 'effort' or 'window', as a list for messages."""
    ours = (name for name in planner_names() if registry.find("planners", name).ours)
    return ", ".join(name for name in ours if support in getattr(planner_class(name), "supports", ()))


def planner_class(name: str) -> type:
    """The class behind a name, to read its `guarantee` or its fields. Raises ScenarioError for an unknown name."""
    return cast(type, registry.target("planners", name))
