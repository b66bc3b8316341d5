"""Maps, plan graphs and SUMO networks, made once and used by every run of a process."""

from collections.abc import Callable, Hashable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:  # loaded with the first map: workers are there at once
    from mrp_sumo.core.graph import PlanGraph
    from mrp_sumo.io.scenario.map import Discretisation, MapChoice
    from mrp_sumo.maps.building import Building
    from mrp_sumo.maps.load import Map

MAX_KEPT = 48  # things made; a suite with more maps makes some of them again

T = TypeVar("T")


class MapCache:
    """A context: networks are files in a temporary folder that goes with it."""

    def __init__(self) -> None:
        self._made: dict[Hashable, Any] = {}
        self._scratch = TemporaryDirectory(prefix="mrp_sumo_")
        self._count = 0

    def __enter__(self) -> "MapCache":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._scratch.cleanup()

    def map(self, choice: "MapChoice", folder: Path, cell_m: float, robot_radius_m: float, driven: tuple[str, ...] = ()) -> "Map":
        """The map that a scenario in `folder` chooses, for types of vehicles, repaired as it asks for. Raises MapError."""
        from mrp_sumo.maps.catalogue import find_map
        from mrp_sumo.maps.furniture import with_furniture
        from mrp_sumo.maps.load import load_map
        from mrp_sumo.maps.repair import repair
        from mrp_sumo.plugins.source import resolved

        path = find_map(choice.file, folder)
        state = path.stat()

        def make(types: tuple[str, ...] = ()) -> "Map":
            map_ = load_map(
                path,
                graph=choice.graph,
                level=choice.level,
                meters_per_pixel=choice.meters_per_pixel,
                cell_m=cell_m,
                robot_radius_m=robot_radius_m,
                vehicle_type=choice.vehicle_type,
                driven=types,
                reader=choice.reader,
                beside=folder,
            )
            repaired, _ = repair(
                with_furniture(map_, {each.model: (each.length_m, each.width_m) for each in choice.furniture}),
                snap_m=choice.snap_m,
                split_at_crossings=choice.split_crossings,
                join_short_m=choice.join_short_m,
                only_largest=choice.largest_component,
            )
            return repaired

        reader = choice.reader and resolved(choice.reader, folder)
        key = (path.resolve(), state.st_mtime_ns, state.st_size, choice, reader, cell_m, robot_radius_m)
        map_ = self._once(key, make)
        if choice.vehicle_type is not None or not set(driven) & set(map_.vehicle_types):
            return map_
        return self._once((*key, driven), lambda: make(driven))

    def graph(self, map_: "Map", choice: "Discretisation", doubled: frozenset[int] = frozenset(), *, curved: bool = True) -> "PlanGraph":
        """The nav graph of a map as it is planned on, some lanes of a roadmap as two tracks; curves are straight steps unless `curved`."""
        from mrp_sumo.core.graph import PlanGraph
        from mrp_sumo.maps.grid import paper_grid
        from mrp_sumo.maps.roadmap import cut_lanes

        nav = map_.nav
        if isinstance(nav, PlanGraph):  # a grid map is one already
            return nav

        def make() -> PlanGraph:
            if choice.kind == "grid":
                return paper_grid(nav, choice.cell_m)
            cut = cut_lanes(nav, choice.cell_m, choice.lanes == "two_way" or doubled)
            return cut if curved else replace(cut, curves={})

        return self._once((nav, choice, doubled, curved), make)

    def of(self, make: Callable[..., T], graph: "PlanGraph", *more: Hashable) -> T:
        """The result of a function of a plan graph and of what else it needs, made once."""
        return self._once((make, graph, *more), lambda: make(graph, *more))

    def network(self, graph: "PlanGraph", backdrop: "Building | None" = None) -> Path:
        """The SUMO network of a plan graph, with a building drawn behind it for those who look."""
        from mrp_sumo.engines.sumo.network import build_network

        self._count += 1
        path = Path(self._scratch.name) / str(self._count) / "network.net.xml"

        def make() -> Path:
            path.parent.mkdir()
            return build_network(graph, path, backdrop)

        return self._once(("network", graph, backdrop is None), make)

    def _once(self, key: Hashable, make: Callable[[], T]) -> T:
        """What was made under `key`, or is made now."""
        if key not in self._made:
            if len(self._made) >= MAX_KEPT:
                self._made.clear()
            self._made[key] = make()
        made: T = self._made[key]
        return made
