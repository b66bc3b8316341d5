"""Videos of runs: checks what is asked for, films it, and writes it with a poster beside it."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.reports.pictures.view import AnyRun
from mrp_sumo.reports.video.canvas import Pixels
from mrp_sumo.reports.video.encode import FPS, SIZE, kind_of, write_png, write_video
from mrp_sumo.reports.video.film import Film, Timing
from mrp_sumo.reports.video.scene import scene_of

MOST_RUNS = 4
SHORT_S = 60.0  # a film lasts about as long at most, unless a speed is asked for
SPEEDS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


@dataclass(frozen=True)
class Wanted:
    """Contents of a video."""

    from_s: float = 0.0
    to_s: float | None = None  # the end of the longest run
    speed: float | None = None  # simulated seconds a second; None: 1, or as much as makes it a minute
    size: tuple[int, int] | None = None  # pixels
    robots: tuple[str, ...] = ()  # names of those to bring out
    level: str | None = None
    titles: tuple[str, ...] = ()  # instead of the runs' names


def render_video(runs: Sequence[AnyRun], path: str, wanted: Wanted, report: Callable[[int, int], None] | None = None) -> tuple[str, Path]:
    """Make a video of one run, or of up to four on one clock. Returns it in words, and a frame of it, `.png` beside it.

    Raises MrpSumoError for what cannot be shown or written. The path ends in .mp4, .gif, .webp, or in / for a folder of PNG; `report`
    is called with the number of frames done and of all.
    """
    kind = kind_of(path)
    if len(runs) > MOST_RUNS:
        raise MrpSumoError(f"{len(runs)} runs, expected at most {MOST_RUNS} in a video")
    if wanted.titles and len(wanted.titles) != len(runs):
        raise MrpSumoError(f"--titles: found {len(wanted.titles)}, expected one for each of {len(runs)} runs")
    scenes = [scene_of(run, robots=wanted.robots, level=wanted.level) for run in runs]
    if wanted.titles:
        scenes = [replace(scene, title=title) for scene, title in zip(scenes, wanted.titles)]
    end_s = max(scene.end_s for scene in scenes)
    if not end_s:
        raise MrpSumoError("nobody moved, the run lasts 0 s: a picture shows it, --at 0 --out FILE")
    to_s = end_s if wanted.to_s is None else min(wanted.to_s, end_s)
    if not 0 <= wanted.from_s < end_s:
        raise MrpSumoError(f"--from {wanted.from_s:g}: is outside the run, which lasts from 0 to {end_s:g} s")
    if not to_s > wanted.from_s:
        raise MrpSumoError(f"--to {wanted.to_s:g}: expected a time after {wanted.from_s:g} s")
    size = wanted.size or SIZE[kind]
    lasts_s = to_s - wanted.from_s
    speed = wanted.speed or next((s for s in SPEEDS if lasts_s / s <= SHORT_S), math.ceil(lasts_s / SHORT_S))
    timing = Timing(wanted.from_s, to_s, speed, FPS[kind])
    film = Film(scenes, timing, size)
    poster = film.poster().copy()
    num_frames = len(timing.t_s)

    def counted() -> Iterator[Pixels]:
        for k, frame in enumerate(film.frames()):
            yield frame
            if report:
                report(k + 1, num_frames)

    out = Path(path)
    write_video(counted(), poster, out, kind, timing.fps)
    beside = out / "poster.png" if kind == "" else out.with_suffix(".png")
    write_png(poster, beside)
    length = f"{num_frames} frames" if kind == "" else f"{num_frames / timing.fps:.1f} s"
    weight = "" if kind == "" else f", {out.stat().st_size / 1e6:.1f} MB"
    return f"{path} ({length} at {speed:g}x, {size[0]} x {size[1]}{weight})", beside
