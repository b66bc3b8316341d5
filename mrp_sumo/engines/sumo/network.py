"""Makes the SUMO network of a graph with netconvert: one lane of the graph is one SUMO edge.

Without internal links, unregulated, with every connection written out and lane shapes straight from
vertex to vertex, so that travel times are the plan's, short lanes and U-turns work, and positions do not
jump. SUMO does not protect vertices in such a network: the executor does. Refuses a graph without
lanes; vertices without lanes are left out.
"""

import errno
import os
import re
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mrp_sumo.core.graph import IntArray, NavGraph
from mrp_sumo.errors import MapError
from mrp_sumo.files.writing import written_whole
from mrp_sumo.maps.building import WALL_THICKNESS_M, Building
from mrp_sumo.maps.cache import remembered

NO_LIMIT_MPS = 2.0  # of lanes without a limit; SUMO looks for followers by it, at 30 m/s an insertion takes 30 ms
LANE_WIDTH_M = 0.3  # drawn only
SHORTEST_M = 0.1  # SUMO makes shorter edges this long
THINNEST_M = 0.01  # netconvert drops edges below
ELEMENT = re.compile(  # of a network: an edge, a connection of two edges, a junction
    r'\s*<(?:edge id="(\w+)".*?</edge>|connection from="(\w+)" to="(\w+)"[^>]*/>|junction id="n(\d+)"[^>]*/>)', re.DOTALL
)
INCOMING = re.compile(r'(?<= incLanes=")[^"]+')  # lanes that lead to a junction
OPPOSITE = re.compile(r' bidi="(\w+)"')


def edge_name(tail: int, head: int) -> str:
    """The SUMO edge of the lane from vertex `tail` to vertex `head`: `e7_9`."""
    return f"e{tail}_{head}"


def lane_ends(edge: str) -> tuple[int, int]:
    """Tail and head vertex of the lane whose SUMO edge this is."""
    tail, head = edge.removeprefix("e").split("_")
    return int(tail), int(head)


def build_network(graph: NavGraph, path: Path, building: Building | None = None) -> Path:
    """Write the SUMO network of a graph, whose vertex v is the junction `n<v>`, to `path`, whole or not at all. Returns the path.

    Floors and walls of a building go to `<name>.poly.xml` beside it, as a backdrop for sumo-gui. Raises MapError for a graph without lanes,
    and when netconvert fails, and OSError where the temporary folder's disk is full.
    """
    path = Path(path)
    if not graph.num_lanes:
        raise MapError(f"'{graph.name}' has no lanes, so there is no network to make")
    path.parent.mkdir(parents=True, exist_ok=True)
    content = b"".join(a.tobytes() for a in (graph.xy, graph.tail, graph.head, graph.length_m, graph.speed_mps))
    _write(path, remembered("network", content, lambda: _network(graph)))
    if building is not None and (backdrop := list(_backdrop(building))):
        _write(backdrop_of(path), _document("additional", backdrop))
    return path


def backdrop_of(path: Path) -> Path:
    """The file in which floors and walls of the network at `path` are drawn, if they are."""
    return path.with_name(path.name.removesuffix(".net.xml").removesuffix(".xml") + ".poly.xml")


def excerpt(text: str, graph: NavGraph, lanes: IntArray, onward: IntArray) -> str:
    """A network's text with only lanes that robots may be on, and pairs of them, `onward` [K, 2], that may follow each other.

    SUMO needs time and memory for whatever it loads.
    """
    edge = [edge_name(a, b) for a, b in zip(graph.tail.tolist(), graph.head.tolist())]
    edges = {edge[lane] for lane in lanes.tolist()}
    passed = {(edge[before], edge[after]) for before, after in onward.tolist()}
    touched = set(map(str, np.union1d(graph.tail[lanes], graph.head[lanes]).tolist()))

    def shorten(element: re.Match[str]) -> str:
        name, before, after, vertex = element.groups()
        if name is not None:
            if name not in edges:
                return ""
            opposite = OPPOSITE.search(element[0])
            return element[0] if opposite is None or opposite[1] in edges else element[0].replace(opposite[0], "", 1)
        if vertex is None:
            return element[0] if (before, after) in passed else ""
        if vertex not in touched:
            return ""
        return INCOMING.sub(lambda match: " ".join(lane for lane in match[0].split() if lane.removesuffix("_0") in edges), element[0])

    return ELEMENT.sub(shorten, text)


def _network(graph: NavGraph) -> str:
    edges = [edge_name(a, b) for a, b in zip(graph.tail.tolist(), graph.head.tolist())]
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        (work / "x.nod.xml").write_text(_document("nodes", _nodes(graph)))
        (work / "x.edg.xml").write_text(_document("edges", _edges(graph, edges)))
        (work / "x.con.xml").write_text(_document("connections", _connections(graph, edges)))
        _netconvert(work)
        text = (work / "x.net.xml").read_text()
    if not text.rstrip().endswith("</net>"):  # netconvert says nothing of what it could not write
        raise OSError(errno.ENOSPC, "", tempfile.gettempdir())
    text = re.sub(r"<!--.*?-->\s*", "", text, count=1, flags=re.DOTALL)  # netconvert's header carries date and paths
    return _straight(text, graph, edges)


def _document(root: str, lines: list[str] | Iterator[str]) -> str:
    return f"<{root}>\n" + "\n".join(lines) + f"\n</{root}>\n"


def _write(path: Path, text: str) -> None:
    with written_whole(path) as part:
        part.write_text(text)


def _nodes(graph: NavGraph) -> Iterator[str]:
    used = np.union1d(graph.tail, graph.head)
    for v, (x, y) in zip(used.tolist(), graph.xy[used].tolist()):
        yield f'<node id="n{v}" x="{x:.6f}" y="{y:.6f}" type="unregulated"/>'


def _edges(graph: NavGraph, edges: list[str]) -> Iterator[str]:
    limit = np.where(np.isfinite(graph.speed_mps), graph.speed_mps, NO_LIMIT_MPS)
    columns = (graph.tail, graph.head, limit, np.maximum(graph.length_m, SHORTEST_M), graph.reverse)
    width = _width_m(graph)
    for edge, tail, head, speed, length, reverse in zip(edges, *(c.tolist() for c in columns)):
        bidi = f' bidi="{edges[reverse]}"' if reverse >= 0 else ""
        yield (
            f'<edge id="{edge}" from="n{tail}" to="n{head}" numLanes="1" speed="{speed:.6f}" width="{width:.3f}" '
            f'spreadType="center" length="{length:.6f}"{bidi}/>'
        )


def _connections(graph: NavGraph, edges: list[str]) -> Iterator[str]:
    first = graph.first.tolist()
    for lane, head in enumerate(graph.head.tolist()):
        for onward in range(first[head], first[head + 1]):
            yield f'<connection from="{edges[lane]}" to="{edges[onward]}" fromLane="0" toLane="0"/>'


def _netconvert(work: Path) -> None:
    import sumo  # the eclipse-sumo package: knows where its programs are

    command = [
        str(Path(sumo.SUMO_HOME) / "bin" / "netconvert"),
        *("-n", "x.nod.xml", "-e", "x.edg.xml", "-x", "x.con.xml", "-o", "x.net.xml"),
        *("--no-internal-links", "true", "--offset.disable-normalization", "true", "--precision", "6", "--xml-validation", "never"),
        *("--roundabouts.guess", "false"),  # SUMO refuses one of which not all edges are loaded
    ]
    try:
        done = subprocess.run(command, cwd=work, capture_output=True, text=True, env={**os.environ, "SUMO_HOME": sumo.SUMO_HOME})
    except OSError as error:
        raise MapError(f"netconvert cannot be started: {error}") from error
    if done.returncode:
        said = [line for line in done.stderr.splitlines() if line.startswith("Error")] or [f"exit code {done.returncode}"]
        raise MapError(f"netconvert refused the network: {said[0]}")


def _width_m(graph: NavGraph) -> float:
    """How broad lanes are drawn: on a dense grid so that one still sees through."""
    return min(LANE_WIDTH_M, max(float(graph.length_m.min(where=~graph.is_ride, initial=np.inf)) / 3, THINNEST_M))


def _straight(text: str, graph: NavGraph, edges: list[str]) -> str:
    """The network drawn as it is: lanes from vertex to vertex, which netconvert ends metres before, and small junctions."""
    ends = np.concatenate([graph.xy[graph.tail], graph.xy[graph.head]], axis=1).tolist()
    shape = {f"{edge}_0": f"{x0:.6f},{y0:.6f} {x1:.6f},{y1:.6f}" for edge, (x0, y0, x1, y1) in zip(edges, ends)}
    named = re.compile(r' id="([^"]+)"')
    drawn = re.compile(r' shape="[^"]*"')

    def straighten(tag: re.Match[str]) -> str:
        match = named.search(tag[0])
        assert match is not None
        return drawn.sub(f' shape="{shape[match[1]]}"', tag[0])

    half = _width_m(graph) / 2

    def shrink(tag: re.Match[str]) -> str:
        x, y = float(tag[1]), float(tag[2])
        corners = ((-half, -half), (-half, half), (half, half), (half, -half))
        return drawn.sub(' shape="' + " ".join(f"{x + dx:.6f},{y + dy:.6f}" for dx, dy in corners) + '"', tag[0])

    text = re.sub(r"<lane [^>]*>", straighten, text)
    return re.sub(r'<junction [^>]* x="([^"]+)" y="([^"]+)"[^>]*>', shrink, text)


def _backdrop(building: Building) -> Iterator[str]:
    """Floors as grey areas, walls as black lines, of all levels."""
    for name, level in building.levels.items():
        for k, floor in enumerate(level.floors):
            corners = " ".join(f"{x:.3f},{y:.3f}" for x, y in level.xy[list(floor)].tolist())
            yield f'<poly id="floor_{name}_{k}" type="floor" color="225,225,225" fill="1" layer="-20" shape="{corners}"/>'
        for k, ((x0, y0), (x1, y1)) in enumerate(level.wall_xy.tolist()):
            yield (
                f'<poly id="wall_{name}_{k}" type="wall" color="40,40,40" fill="0" lineWidth="{WALL_THICKNESS_M}" layer="-10" '
                f'shape="{x0:.3f},{y0:.3f} {x1:.3f},{y1:.3f}"/>'
            )
