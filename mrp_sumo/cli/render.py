"""Draw a run at a moment as a picture, or over time as a video; several runs beside each other on one clock.

--at T --out FILE draws a picture, --video FILE a video, with a poster (.png) beside it. Neither needs a screen.
MP4 needs the extra `video`: pip install 'mrp-sumo[video]'.
"""

import argparse
import math
import re
from pathlib import Path

from mrp_sumo.cli.option_rules import only_for
from mrp_sumo.cli.printing import say_either, say_progress
from mrp_sumo.cli.result_folder import run_folder
from mrp_sumo.errors import MrpSumoError


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo render`."""
    parser.add_argument("run", nargs="+", type=run_folder, help="run folder, as `mrp-sumo run --out` makes it; up to four for a video")
    parser.add_argument("--at", type=float, metavar="T", help="simulated time in s, for a picture")
    parser.add_argument("--out", metavar="FILE", help="the picture, .png or .svg")
    parser.add_argument("--dpi", type=float, metavar="N", help="of a PNG (default: 150)")
    parser.add_argument("--video", metavar="FILE", help="the video, .mp4, .gif or .webp; or FOLDER/ for a PNG file of each frame")
    parser.add_argument("--from", dest="from_s", type=float, metavar="T", help="simulated time at which it begins, in s")
    parser.add_argument("--to", dest="to_s", type=float, metavar="T", help="and ends (default: with the run)")
    parser.add_argument("--speed", type=float, metavar="X", help="times real time (default: 1, or what makes it a minute)")
    parser.add_argument("--size", metavar="WxH", help="pixels (default: 1920x1080; of .gif and .webp 960x540)")
    parser.add_argument("--robots", metavar="A,B,...", help="bring these robots out, with names and plans; the others are pale")
    parser.add_argument("--level", metavar="NAME", help="show this level alone")
    parser.add_argument("--json", action="store_true", help="print the files as a line of JSON")
    parser.add_argument("--titles", nargs="+", metavar="TEXT", help="a title for each run instead of its name")


def run(options: argparse.Namespace) -> int:
    """Draw the picture or the video."""
    if options.video is not None:
        return _video(options)
    if options.at is None or options.out is None:
        raise MrpSumoError("expected --at T and --out FILE for a picture, or --video FILE; see `mrp-sumo render --help`")
    if len(options.run) > 1:
        raise MrpSumoError("a picture shows one run; --video shows several beside each other")
    of_video = {name: getattr(options, name) for name in ("speed", "size", "robots", "level", "titles")}
    only_for("--video", from_=options.from_s, to=options.to_s, **of_video)
    if options.dpi is not None and options.out.lower().endswith(".svg"):
        raise MrpSumoError("--dpi is for PNG files: an SVG has no pixels")
    dpi = 150.0 if options.dpi is None else options.dpi
    if not (math.isfinite(dpi) and 10 <= dpi <= 1200):
        raise MrpSumoError(f"--dpi {dpi:g}: expected 10 to 1200")
    if not options.at >= 0:
        raise MrpSumoError(f"--at {options.at:g}: is outside the run, which begins at 0 s")
    from mrp_sumo.io.run_reader import load_run
    from mrp_sumo.reports.pictures.still import render_still

    file = render_still(load_run(options.run[0]), options.at, Path(options.out), dpi=dpi)
    say_either(options.json, {"file": str(file)}, file)
    return 0


def _video(options: argparse.Namespace) -> int:
    if options.at is not None or options.out is not None:
        raise MrpSumoError("--video: --at and --out are for a picture; a video has --from and --to")
    only_for("a picture; a video has --size", dpi=options.dpi)
    if options.speed is not None and not (math.isfinite(options.speed) and 0.01 <= options.speed <= 10_000):
        raise MrpSumoError(f"--speed {options.speed:g}: expected 0.01 to 10000")
    if options.from_s is not None and not options.from_s >= 0:
        raise MrpSumoError(f"--from {options.from_s:g}: is outside the run, which begins at 0 s")
    size = _size(options.size) if options.size else None
    from mrp_sumo.io.run_reader import load_run
    from mrp_sumo.reports.video.encode import kind_of
    from mrp_sumo.reports.video.video import Wanted, render_video

    kind_of(options.video)
    wanted = Wanted(
        from_s=options.from_s or 0.0,
        to_s=options.to_s,
        speed=options.speed,
        size=size,
        robots=tuple(options.robots.split(",")) if options.robots else (),
        level=options.level,
        titles=tuple(options.titles or ()),
    )

    def report(done: int, of: int) -> None:
        if done % 10 == 0 or done == of:
            say_progress(f"frame {done} of {of}", is_last=done == of)

    about, poster = render_video([load_run(folder) for folder in options.run], options.video, wanted, report)
    say_either(options.json, {"file": options.video, "poster": str(poster)}, f"{about}, poster {poster}")
    return 0


def _size(text: str) -> tuple[int, int]:
    """Width and height in pixels, even as video needs them."""
    match = re.fullmatch(r"(\d{2,4})x(\d{2,4})", text)
    size = (int(match[1]), int(match[2])) if match else (0, 0)
    if not all(240 <= n <= 4320 and n % 2 == 0 for n in size):
        raise MrpSumoError(f"--size {text}: expected even numbers of pixels from 240 to 4320, such as 1920x1080")
    return size
