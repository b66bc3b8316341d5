"""Draw a site in the browser, run it, ask it: a workbench over the files of a folder.

MAP is a map of any format that `mrp-sumo import` reads or the name of a bundled one, PLAN a floor plan (DXF or a picture), FOLDER a folder
to work in (default: the current one). The page is served on this machine alone until Ctrl+C, behind a token; everything done there is
files in the folder that the command line reads: building.yaml, scenarios, runs, studies.
"""

import argparse
from pathlib import Path

from mrp_sumo.cli.ending import until_ctrl_c
from mrp_sumo.cli.option_rules import port_number
from mrp_sumo.cli.printing import say_either
from mrp_sumo.errors import MapError


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo studio`."""
    parser.add_argument("place", nargs="?", default=".", metavar="MAP|PLAN|FOLDER", help="what to open (default: the current folder)")
    parser.add_argument("--port", type=port_number, default=0, metavar="N", help="to listen at (default: any free port)")
    parser.add_argument("--no-browser", action="store_true", help="print the address and open no browser")
    parser.add_argument("--json", action="store_true", help="print the address as a line of JSON")


def run(options: argparse.Namespace) -> int:
    """Serve until Ctrl+C."""
    import webbrowser

    from mrp_sumo.files.reading import read_head
    from mrp_sumo.maps.catalogue import bundled_maps, find_map
    from mrp_sumo.maps.readers.reader import HEAD
    from mrp_sumo.maps.readers.strangers import advice
    from mrp_sumo.studio.server import Studio
    from mrp_sumo.studio.workspace import BUNDLED

    place = Path(options.place)
    if place.is_dir():
        root, opened = place, ""
    elif not place.is_file() and options.place in bundled_maps():
        root, opened = Path(), f"{BUNDLED}{options.place}"
    else:
        path = find_map(options.place, Path()).resolve()
        if stranger := advice(read_head(path, HEAD, MapError)):
            raise MapError(f"{options.place}: {stranger}")
        root, opened = path.parent, path.name
    studio = Studio(root, opened, options.port)
    try:
        with until_ctrl_c():
            about = {"address": studio.address, "folder": str(root.resolve()), "opens": opened}
            say_either(options.json, about, f"{studio.address} (Ctrl+C ends)")
            if not options.no_browser:
                webbrowser.open(studio.address)
            studio.server.serve_forever()
    finally:
        studio.close()
    return 0
