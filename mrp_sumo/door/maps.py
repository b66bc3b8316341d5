"""Maps for people: loaded by name or file, drawn, and turned into networkx graphs."""

import atexit
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from mrp_sumo.core.graph import NavGraph
from mrp_sumo.errors import MapError, count
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.io.documents import Document, validated
from mrp_sumo.io.scenario.map import Discretisation, MapChoice
from mrp_sumo.io.summary import Summary, summary, with_summary
from mrp_sumo.maps.facts import driven_levels, extent_m, num_drawn_edges, num_driven_components
from mrp_sumo.maps.map import Map

if TYPE_CHECKING:
    import networkx

    from mrp_sumo.reports.pictures.picture import Picture

READ_BACK = (".nav.yaml", ".map")
DEFAULT_CELL_M: float = Discretisation.model_fields["cell_m"].default


@cache
def shared_maps() -> MapCache:
    """The maps and networks of this process; their files go with it."""
    maps = MapCache()
    atexit.register(maps.__exit__, None, None, None)
    return maps


@with_summary
@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Site(Map):
    """A map, with a face for people."""

    choice: MapChoice  # how it was loaded: what a scenario says under `map`

    @property
    def num_components(self) -> int:
        """Connected pieces that have lanes, levels joined by lifts."""
        return num_driven_components(self.nav)

    @property
    def num_edges(self) -> int:
        """Lanes, opposite ones counted once, without those of lifts."""
        return num_drawn_edges(self.nav)

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height of lanes and walls; of several levels, as they are laid side by side."""
        width, height = extent_m(self)
        return width, height

    def plot(self, *, findings: bool = True) -> "Picture":
        """Draw the map: walls, lanes with their directions, stations, and findings where they are.

        Parameters
        ----------
        findings
            Whether to mark the findings that have a place.

        Returns
        -------
        Picture
            A matplotlib figure that notebooks show by themselves; `write` saves it as PNG or SVG.
        """
        from mrp_sumo.reports.pictures.map_picture import map_picture

        return map_picture(self, findings=findings)

    def to_networkx(self) -> "networkx.DiGraph":
        """The nav graph as a directed graph of networkx; see `NavGraph.to_networkx`."""
        return self.nav.to_networkx()

    @property
    def _summary(self) -> Summary:
        nav = self.nav
        rows: list[tuple[str, object]] = [
            ("file", self.path),
            ("levels", ", ".join(driven_levels(nav)) if len(nav.level_names) > 1 else None),
            ("size", "{:.1f} x {:.1f} m".format(*self.size_m)),
            ("graph", f"{count(nav.num_vertices, 'vertex', 'vertices')}, {count(self.num_edges, 'edge')}"),
            ("components", self.num_components),
        ]
        rows += [("repair", change) for change in self.changes]
        rows += [("warning" if finding.severity == "warn" else "note", finding.line) for finding in self.findings]
        return summary(f"Map {self.name}", rows)

    def __repr__(self) -> str:
        parts = [count(self.nav.num_vertices, "vertex", "vertices"), count(self.num_edges, "edge"), count(self.num_components, "component")]
        parts += ["{:.1f} x {:.1f} m".format(*self.size_m), count(len(self.findings), "finding")]
        return f"<Map {self.name}: {', '.join(parts)}>"


def load_map(
    name_or_path: str | Path,
    *,
    reader: str | None = None,
    graph: int | tuple[int, ...] | Literal["all"] | None = None,
    level: str | None = None,
    meters_per_pixel: float | None = None,
    cell_m: float = DEFAULT_CELL_M,
    robot_radius_m: float | None = None,
    vehicle_type: str | None = None,
    snap_m: float | None = None,
    split_crossings: bool = False,
    join_short_m: float | None = None,
    largest_component: bool = False,
) -> Site:
    """Load a map.

    Parameters
    ----------
    name_or_path
        A map file of any format, or the name of a bundled map such as "office".
    reader
        A map reader by name, or FILE.py:CLASS; by default the one that recognises the file.
    graph
        Which nav graph of a building; several, or "all", are united. The lowest with lanes by default.
    level
        Only this level; all levels that the graph is on by default.
    meters_per_pixel
        Scale of a building's drawing without measurements.
    cell_m
        Side of the cells of a MovingAI or ROS map.
    robot_radius_m
        The room that a robot needs on a ROS map; a TurtleBot3's by default.
    vehicle_type
        Only the lanes for this type of vehicle, where the map knows types; those of all by default.
    snap_m
        Repair: join lane ends that lie this close to a vertex or lane they are not on.
    split_crossings
        Repair: put a vertex where lanes cross without one.
    join_short_m
        Repair: join the ends of lanes shorter than this, where one end has no name and no properties.
    largest_component
        Repair: keep the largest connected piece only.

    Returns
    -------
    Site
        The map; give it to `Scenario(map=...)` as it is.

    Raises
    ------
    MrpSumoError
        For an unknown name, with the nearest right one, and for a map that is refused.

    Examples
    --------
    >>> site = ms.load_map("office")
    >>> site.plot().write(Path("office.png"))
    """
    values = {
        "file": str(name_or_path),
        "reader": reader,
        "graph": graph,
        "level": level,
        "meters_per_pixel": meters_per_pixel,
        "vehicle_type": vehicle_type,
        "snap_m": snap_m,
        "split_crossings": split_crossings,
        "join_short_m": join_short_m,
        "largest_component": largest_component,
    }
    from mrp_sumo.maps.readers.reader import ROBOT_RADIUS_M

    choice = validated(Document(Path("load_map"), values, {}), MapChoice)
    return site_of(shared_maps().map(choice, Path(), cell_m, ROBOT_RADIUS_M if robot_radius_m is None else robot_radius_m), choice)


def save_map(map_or_graph: Map | NavGraph, path: str | Path) -> Site:
    """Write a map, so that scenarios can use it.

    Parameters
    ----------
    map_or_graph
        From `load_map`, or a graph of your own: `NavGraph.from_networkx(graph)`.
    path
        Ends in .nav.yaml (Open-RMF nav graph) or .map (MovingAI). A warning names what the format cannot hold.

    Returns
    -------
    Site
        The map as it is read back.

    Raises
    ------
    MrpSumoError
        For another suffix, a place that cannot be written, and a map that cannot be read back.

    Examples
    --------
    >>> ms.save_map(ms.NavGraph.from_networkx(nx.grid_2d_graph(5, 8)), "grid.nav.yaml")
    """
    from mrp_sumo.io.map_files import write_map

    path = Path(path)
    graph = map_or_graph
    map_ = Map(name=graph.name, path=path, nav=graph) if isinstance(graph, NavGraph) else graph
    if not path.name.endswith(READ_BACK):
        raise MapError(f"{path.name}: expected a name that ends in {' or '.join(READ_BACK)}")
    for loss in write_map(map_, path, DEFAULT_CELL_M):
        warnings.warn(f"{path.name}: lost: {loss}", stacklevel=2)
    return load_map(path)


def site_of(map_: Map, choice: MapChoice) -> Site:
    """A loaded map with its face for people."""
    values: Mapping[str, Any] = {field.name: getattr(map_, field.name) for field in fields(map_)}
    return Site(**values, choice=choice)
