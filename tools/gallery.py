"""Make the gallery: thirteen runs with scenario, run folder, replay page, picture and video, on one page that says what to see in each.

    python tools/gallery.py [--out runs/gallery] [--only NAME ...] [--no-video]

Runs that are there already are kept, so that an interrupted gallery goes on where it was; the largest take minutes.
"""

import argparse
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import networkx as nx
import yaml

import mrp_sumo as ms
from mrp_sumo.reports.tour import TourPage, tour_page

PROJECT = Path(__file__).resolve().parents[1]
SIDE_M = 1.0  # between vertices of the drawn maps


@dataclass(frozen=True)
class Entry:
    """A run of the gallery."""

    name: str
    title: str
    see: str  # in it
    scenario: dict[str, Any]
    graph: nx.Graph | None = None  # its map, if it is none of the bundled ones
    from_s: float = 0.0  # of the video
    to_s: float | None = None
    recorded: bool = False  # shown as it is read back from its VDA 5050 messages


def lane(num: int, pocket: int | None = None) -> nx.Graph:
    """A corridor of one lane, c0 to c(num - 1), with a place to give way beside one vertex."""
    graph = nx.path_graph(num)
    for k in range(num):
        graph.nodes[k].update(x_m=SIDE_M * k, y_m=0.0, name=f"c{k}")
    if pocket is not None:
        graph.add_node("pocket", x_m=SIDE_M * pocket, y_m=SIDE_M, name="pocket")
        graph.add_edge(pocket, "pocket")
    return graph


def ring(columns: int, rows: int) -> nx.Graph:
    """A ring of lanes around a block, r0, r1, ... in order."""
    places = [(x, 0) for x in range(columns)] + [(columns - 1, y) for y in range(1, rows)]
    places += [(x, rows - 1) for x in range(columns - 2, -1, -1)] + [(0, y) for y in range(rows - 2, 0, -1)]
    graph = nx.cycle_graph(len(places))
    for k, (x, y) in enumerate(places):
        graph.nodes[k].update(x_m=SIDE_M * x, y_m=SIDE_M * y, name=f"r{k}")
    return graph


def between(starts: list[str], goals: list[str], **more: Any) -> dict[str, Any]:
    """The scenario of robots with starts and goals on a drawn map."""
    robots = {"starts": starts, "goals": goals}
    return {"discretisation": {"kind": "roadmap"}, "robots": robots, "assignment": {"mode": "fixed"}, "record": {"bag": False}, **more}


ENTRIES = (
    Entry(
        "head_on",
        "Head-on in a corridor",
        "Two robots want through the same lane. The planner lets one step aside into the pocket; nobody could turn back later.",
        between(["c0", "c8"], ["c8", "c0"], planner="cbs"),
        lane(9, pocket=4),
    ),
    Entry(
        "rotation",
        "A ring turns",
        "Nine robots on ten places, each wants the next but two. The one gap travels backwards through the ring.",
        between([f"r{k}" for k in range(9)], [f"r{(k + 3) % 10}" for k in range(9)], planner="lacam"),
        ring(4, 3),
    ),
    Entry(
        "convoy",
        "A convoy",
        "Six robots follow each other down a lane. Each starts when the one ahead has left enough room to brake.",
        between([f"c{k}" for k in range(6)], [f"c{k + 8}" for k in range(6)], planner="prioritised"),
        lane(14),
    ),
    Entry(
        "lift_queue",
        "A queue for two lifts",
        "Six robots go up from the ground floor. A cabin takes one of them; the others wait where they are not in the way of the doors.",
        {
            "map": "hospital_levels",
            "discretisation": {"kind": "roadmap", "cell_m": 1.2},
            "robots": {
                "starts": ["L1_parking_1", "L1_parking_2", "L1_charger_1", "L1_charger_2", "L1_pharmacy", "L1_kitchen"],
                "goals": ["L2_ward_21", "L2_ward_22", "L3_ward_31", "L3_ward_32", "L2_laboratory", "L3_medicine"],
            },
            "assignment": {"mode": "fixed"},
            "planner": "prioritised",
            "execution": {"doors": "automatic"},
            "record": {"bag": False},
        },
    ),
    Entry(
        "breakdown",
        "A robot breaks down",
        "robot_0 stops for good after eight seconds. Those whose way it blocks are sent around it; its own goal stays empty.",
        {
            "map": "office",
            "robots": 9,
            "planner": "lacam",
            "execution": {"on_deadlock": "resolve", "time_limit_s": 120, "disturbances": {"breakdowns": [{"robot": 0, "begin_s": 8}]}},
            "record": {"bag": False},
        },
        to_s=90.0,
    ),
    Entry(
        "orders",
        "Orders in a warehouse",
        "Work comes while robots drive. Watch the tab of tasks: open orders, stations that are busy, who carries what.",
        {"extends": "warehouse_lifelong", "execution": {"time_limit_s": 600}, "record": {"bag": False}},
        from_s=60.0,
        to_s=360.0,
    ),
    Entry(
        "collapse",
        "Congestion",
        "Thirty robots, and always sixty orders: they queue for two packing tables. Switch the heat map on, or look at that aisle.",
        {
            "extends": "warehouse_lifelong",
            "robots": {"count": 30, "draw": "anywhere"},
            "tasks": {"open": 60},
            "execution": {"engine": "kinematic", "time_limit_s": 600},
            "record": {"bag": False},
        },
        from_s=300.0,
        to_s=420.0,
    ),
    Entry(
        "plant_forklifts",
        "A working day of eight forklifts",
        "They turn on arcs and back out of the stations. Go to a grey piece of the line of disturbances: one has broken down, is pushed "
        "aside after three minutes, and the others pass. The shift changes after four hours: see who waits at the machines.",
        {"extends": "plant_forklifts"},
        from_s=13800.0,
        to_s=14700.0,
    ),
    Entry(
        "plant_tuggers",
        "Milk runs with three trailers",
        "Two tuggers go round, with up to three loads each. Follow one into a corner: each trailer runs a little inside the one ahead.",
        {"extends": "plant_tuggers"},
        from_s=60.0,
        to_s=360.0,
    ),
    Entry(
        "people",
        "People in a hospital",
        "Staff, visitors and patients walk among ten robots. These slow down, stop, and go on when the way is free.",
        {"extends": "hospital_people", "execution": {"time_limit_s": 900}, "record": {"bag": False}},
        from_s=300.0,
        to_s=600.0,
    ),
    Entry(
        "airport_100",
        "A hundred robots in an airport",
        "One plan for all, driven in its order. Long corridors, few crossings: that is where they wait for each other.",
        {"map": "airport", "robots": {"count": 100, "type": "turtlebot3"}, "planner": "lacam", "record": {"bag": False}},
        to_s=180.0,
    ),
    Entry(
        "vda5050",
        "Vehicles that speak VDA 5050",
        "Made of the orders, states and visualisations of five vehicles alone, as a broker of any fleet would have recorded them.",
        {"map": "office", "robots": 5, "planner": "cbs", "record": {"bag": False}},
        recorded=True,
    ),
    Entry(
        "thousand",
        "A thousand robots",
        "LaCAM plans for all of them on 60 by 60 vertices. Most are at their goals after half a minute, the last after 73 s.",
        {
            "robots": {"count": 1000, "type": "turtlebot3", "draw": "anywhere"},
            "planner": {"name": "lacam", "time_limit_s": 60},
            "execution": {"engine": "kinematic", "time_limit_s": 600},
            "record": {"bag": False},
        },
        nx.grid_2d_graph(60, 60),
        to_s=120.0,
    ),
)


def main() -> int:
    """Make what is missing, then the page. Exit code 1 when a run could not be made."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("runs/gallery"))
    parser.add_argument("--only", nargs="+", choices=[entry.name for entry in ENTRIES], metavar="NAME")
    parser.add_argument("--no-video", action="store_true")
    options = parser.parse_args()
    stops, failed = [], 0
    for entry in ENTRIES:
        if options.only and entry.name not in options.only:
            continue
        place = options.out / entry.name
        if made(entry, place, video=not options.no_video):
            video = place / "video.mp4"
            links = [("scenario", f"{entry.name}/{entry.name}.yaml"), ("picture", f"{entry.name}/picture.png")]
            if video.is_file():
                links.append((f"video, {video.stat().st_size / 1e6:.1f} MB", f"{entry.name}/video.mp4"))
            stops.append(TourPage(entry.title, entry.see, f"{entry.name}/run/replay.html", f"{entry.name}/picture.png", links=tuple(links)))
        else:
            failed += 1
    lead = "Each opens as a page to play with; the run folder lies beside it."
    (options.out / "index.html").write_text(tour_page(stops, "Gallery", lead), encoding="utf-8")
    print(options.out / "index.html")
    return 1 if failed else 0


def made(entry: Entry, place: Path, *, video: bool) -> bool:
    """Whether a run and its pictures are there, made now where they were missing."""
    place.mkdir(parents=True, exist_ok=True)
    scenario = {"name": entry.name, **entry.scenario}
    if base := scenario.pop("extends", None):
        scenario = ms.Scenario.read(base).replace(**scenario).values
    if entry.graph is not None:
        scenario["map"] = drawn(entry.graph, place / f"{entry.name}.nav.yaml")
    file = place / f"{entry.name}.yaml"
    file.write_text(yaml.safe_dump(scenario, sort_keys=False), encoding="utf-8")
    out = place / "run"
    if not (out / "replay.html").is_file():
        print(f"{entry.name}: {entry.title}", flush=True)
        driven = place / "driven" if entry.recorded else out
        command("run", str(file), "--out", str(driven))
        if entry.recorded:
            command("export", str(driven), "--vda5050")
            command("import", str(driven / "vda5050" / "messages.jsonl"), "--map", scenario["map"], "--out", str(out))
        if command("replay", str(out)) != 0:
            return False
    end = ("--to", f"{entry.to_s:g}") if entry.to_s else ()
    if video and not (place / "video.mp4").is_file():
        command("render", str(out), "--video", str(place / "video.mp4"), "--from", f"{entry.from_s:g}", *end)
        (place / "video.png").rename(place / "picture.png")
    if not (place / "picture.png").is_file():
        at_s = entry.from_s + 10
        command("render", str(out), "--at", f"{at_s:g}", "--out", str(place / "picture.png"), "--dpi", "100")
    return (place / "picture.png").is_file()


def drawn(graph: nx.Graph, path: Path) -> str:
    """Write a drawn graph as a map; places that nobody gave are those of a grid."""
    for node, place in graph.nodes(data=True):
        if "x_m" not in place:
            place.update(x_m=SIDE_M * node[0], y_m=SIDE_M * node[1], name=f"{node[0]}_{node[1]}")
    ms.save_map(ms.NavGraph.from_networkx(graph, name=path.parent.name), str(path))
    return path.name


def command(*arguments: str) -> int:
    """Run `mrp-sumo` as a user does, without its table."""
    environment = {**os.environ, "PYTHONPATH": str(PROJECT)}
    return subprocess.run([sys.executable, "-m", "mrp_sumo", *arguments], stdout=subprocess.DEVNULL, env=environment).returncode


if __name__ == "__main__":
    sys.exit(main())
