"""Write the replay page of a run: one HTML file that any browser shows, without a network.

--serve shows it at an address of this machine instead, until Ctrl+C.
"""

import argparse
from pathlib import Path

from mrp_sumo.cli.ending import until_ctrl_c
from mrp_sumo.cli.option_rules import only_for, port_number
from mrp_sumo.cli.printing import say, say_either
from mrp_sumo.cli.result_folder import run_folder


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo replay`."""
    parser.add_argument(
        "run", nargs="+", type=run_folder, help="run folder, as `mrp-sumo run --out` makes it; two for a page with both on one clock"
    )
    parser.add_argument("--out", metavar="FILE", help="the page (default: RUN/replay.html, of two RUN/beside_OTHER.html)")
    parser.add_argument("--serve", action="store_true", help="open it in a browser, from a small web server on this machine")
    parser.add_argument("--json", action="store_true", help="print file and size as a line of JSON")
    parser.add_argument("--port", type=port_number, metavar="N", help="of --serve (default: any free port)")


def run(options: argparse.Namespace) -> int:
    """Write the page, and serve it where that is asked for."""
    from mrp_sumo.errors import MrpSumoError
    from mrp_sumo.io.run_reader import load_run
    from mrp_sumo.reports.replay.beside import page_of_two
    from mrp_sumo.reports.replay.page import write_page, write_replay

    first, *others = map(Path, options.run)
    out = Path(options.out) if options.out else None
    if not options.serve:
        only_for("--serve", port=options.port)
    if out is not None and not out.is_dir() and out.suffix.lower() not in (".html", ".htm"):  # of a folder `write_replay` says so
        raise MrpSumoError(f"--out {out}: a page for a browser, expected a name that ends in .html")
    if len(others) > 1:
        raise MrpSumoError(f"{len(options.run)} runs, expected one or two")
    if others:
        page = write_page(page_of_two(load_run(first), load_run(others[0])), out or first / f"beside_{others[0].resolve().name}.html")
    else:
        page = write_replay(first, out)
    size = page.stat().st_size
    say_either(options.json, {"file": str(page), "bytes": size}, f"{page} ({size / 1e6:.1f} MB)")
    if options.serve:
        _serve(page.read_bytes(), options.port or 0)
    return 0


def _serve(page: bytes, port: int) -> None:
    """Show the page at an address of this machine until Ctrl+C."""
    import webbrowser

    from mrp_sumo.wire.gate import LocalHandler, LocalServer

    class ReplayHandler(LocalHandler):
        def do_GET(self) -> None:
            if self.place() is not None:
                self.answer(200, "text/html; charset=utf-8", page)

    with LocalServer(port, ReplayHandler) as server, until_ctrl_c():
        say(f"{server.address} (Ctrl+C ends)")
        webbrowser.open(server.address)
        server.serve_forever()
