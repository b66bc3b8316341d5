"""Films of runs, one or several beside each other on one clock: the floor, robots to scale by state, the plan ahead, who waits for whom.

What lies still is drawn once by matplotlib; what moves is drawn for each frame by its Agg, in pixels.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray
from mrp_sumo.io.record import AT_GOAL, BLOCKED
from mrp_sumo.reports.pictures.floor import LIGHT, STATES, draw_floor
from mrp_sumo.reports.pictures.picture import round_length
from mrp_sumo.reports.pictures.view import ABSENT, drawbars, state_names
from mrp_sumo.reports.video.canvas import Canvas, Pixels, font, shortened_to
from mrp_sumo.reports.video.scene import Scene, SceneState

NAMED = 60  # number of robots up to which each has a name beside it; inside them, names are for all
PLANNED = 200  # number of robots up to which the plan ahead is drawn of all
RINGED = 12  # number of blocked robots up to which each has a ring
AT_ONCE = 256  # frames whose poses are looked up together
HOLD_S = 1.0  # of the film, on its last frame
LEAST_PX = (16.0, 9.0)  # least length of a robot at 1080 lines: up to NAMED robots, and beyond
BOX = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) / 2
NOSE = np.array([(0.5, 0), (0.2, 0.36), (0.2, -0.36)])  # in lengths and widths of a robot
ARROW = np.array([(0.34, 0), (-0.26, 0.3), (-0.12, 0), (-0.26, -0.3)])
FORKS = np.array([[(0.17, y), (0.5, y), (0.5, y + 0.12), (0.17, y + 0.12)] for y in (-0.34, 0.22)])  # that are in front
PLACES = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, 1), (1, -1), (-1, -1))  # of a name beside its robot


@dataclass(frozen=True)
class Timing:
    """Times that a film shows."""

    from_s: float
    to_s: float
    speed: float  # simulated seconds a second
    fps: int

    @property
    def t_s(self) -> FloatArray:
        """[K] the moment of each frame."""
        moving = math.floor((self.to_s - self.from_s) * self.fps / self.speed + 1e-9) + 1
        frames = np.arange(moving + round(HOLD_S * self.fps))
        return np.minimum(self.from_s + frames * self.speed / self.fps, self.to_s)


@dataclass(eq=False)
class Pane:
    """Place of a run in the picture, in pixels from the lower left."""

    scene: Scene
    left: float
    bottom: float
    width: float
    height: float
    title_px: float  # of the strip above the floor
    foot_px: float  # of the strip below
    unit: float  # pixels of a line of 1080

    def __post_init__(self) -> None:
        w, h = self.scene.high - self.scene.low
        room = self.width, self.height - self.title_px - self.foot_px
        self.scale = min(room[0] / w, room[1] / h)  # pixels a metre
        self.corner = np.array((self.left + (room[0] - w * self.scale) / 2, self.bottom + self.foot_px + (room[1] - h * self.scale) / 2))
        self.size = np.array((w, h)) * self.scale
        fleet = self.scene.record.fleet
        self.few = fleet.num_robots <= NAMED
        least = LEAST_PX[not self.few] * self.unit
        grow = np.maximum(1, least / np.maximum(1e-9, fleet.length_m * self.scale))
        self.body = np.column_stack((fleet.length_m, fleet.width_m)) * (grow * self.scale)[:, None]  # [R, 2] px
        inside = 0.46 * float(self.body.min())
        fits = max(len(name) for name in self.scene.name) <= 3 and inside >= 8 * max(1.0, 0.8 * self.unit)
        self.inside_px = min(inside, 17 * self.unit) if fits else 0.0
        self.place = np.zeros(fleet.num_robots, np.int64)  # of each name, in PLACES; kept from frame to frame

    @property
    def clip(self) -> Bbox:
        """The box that may be drawn on."""
        return Bbox.from_bounds(*self.corner, *self.size)

    def pixels(self, xy: FloatArray) -> FloatArray:
        """[N, 2] pixels of points in m."""
        pixels: FloatArray = (xy - self.scene.low) * self.scale + self.corner
        return pixels


class Film:
    """Frames of W x H pixels."""

    def __init__(self, scenes: Sequence[Scene], timing: Timing, size: tuple[int, int]) -> None:
        self.timing, self.size = timing, size
        self.unit = min(size[1] / 1080, size[0] / 1100)
        self.canvas = Canvas(*size, LIGHT["paper"])
        self.panes = _panes(scenes, size, self.unit)
        self.clock_px = font(round(40 * self.unit), True).getlength(clock(timing.to_s)) + 30 * self.unit
        self._draw_still()

    def frames(self) -> Iterator[Pixels]:
        """The frames one after the other; each is valid until the next."""
        t_s = self.timing.t_s
        for k in range(0, len(t_s), AT_ONCE):
            for moments in zip(*(pane.scene.moments(t_s[k : k + AT_ONCE]) for pane in self.panes)):
                yield self.draw(moments)

    def poster(self) -> Pixels:
        """A frame for where the film does not play: a third of the way in."""
        at_s = np.array([self.timing.from_s + (self.timing.to_s - self.timing.from_s) / 3])
        return self.draw([pane.scene.moments(at_s)[0] for pane in self.panes])

    def draw(self, moments: Sequence[SceneState]) -> Pixels:
        """The frame of a moment of each run."""
        self.canvas.clear()
        for pane, state in zip(self.panes, moments):
            _draw_robots(self.canvas, pane, state)
            self._write_counts(pane, state)
            self._draw_track(pane, state.t_s)
        self._write_clock(moments[0].t_s)
        return self.canvas.pixels

    def _draw_still(self) -> None:
        width, height = self.size
        figure = Figure(figsize=(width / 72, height / 72), dpi=72, facecolor=LIGHT["paper"])
        for pane in self.panes:
            (left, bottom), (w, h) = pane.corner, pane.size
            ax = figure.add_axes((left / width, bottom / height, w / width, h / height))
            ax.set_xlim(pane.scene.low[0], pane.scene.high[0])
            ax.set_ylim(pane.scene.low[1], pane.scene.high[1])
            ax.axis("off")
            draw_floor(ax, pane.scene.record, pane.scene.outline, pane.scale, name_pt=max(8.0, 11 * self.unit))
        self.canvas.embed(figure)
        u = self.unit
        for pane in self.panes:
            room = pane.width - (self.clock_px if self._is_under_clock(pane) else 0)
            top = pane.bottom + pane.height
            title = shortened_to(pane.scene.title, 28 * u, room, bold=True)
            about = shortened_to(pane.scene.subtitle, 18 * u, room)
            self.canvas.write(title, (pane.left, top - 26 * u), 28 * u, LIGHT["ink"], bold=True)
            self.canvas.write(about, (pane.left, top - 60 * u), 18 * u, LIGHT["muted"])
            self._draw_scale(pane)
        self.canvas.keep()
        self.tracks = [self._track(pane) for pane in self.panes]

    def _is_under_clock(self, pane: Pane) -> bool:
        return pane.left + pane.width + 0.1 >= max(p.left + p.width for p in self.panes) and pane.bottom + pane.height + 0.1 >= max(
            p.bottom + p.height for p in self.panes
        )

    def _write_clock(self, t_s: float) -> None:
        """The time, each digit in a place of its own so that nothing shakes."""
        u, text = self.unit, clock(t_s)
        margin, top = 40 * u, self.size[1] - 24 * u
        digit = font(round(40 * u), True).getlength("0")
        x = self.size[0] - margin
        for character in reversed(text):
            wide = digit if character.isdigit() else 0.55 * digit
            self.canvas.write(character, (x - wide / 2, top - 22 * u), 40 * u, LIGHT["ink"], bold=True, align="center")
            x -= wide
        speed = f"{self.timing.speed:g}×" if self.timing.speed != 1 else "real time"
        self.canvas.write(
            f"of {clock(self.timing.to_s)} · {speed}", (self.size[0] - margin, top - 60 * u), 18 * u, LIGHT["muted"], align="right"
        )

    def _draw_scale(self, pane: Pane) -> None:
        u = self.unit
        length = round_length(150 * u / pane.scale)
        right, y = pane.left + pane.width, pane.bottom + pane.foot_px - 28 * u
        self.canvas.fill(_rectangle(right - length * pane.scale, y - 1.5 * u, length * pane.scale, 3 * u), LIGHT["muted"])
        self.canvas.write(f"{length:g} m", (right - length * pane.scale - 8 * u, y), 16 * u, LIGHT["muted"], align="right")

    def _write_counts(self, pane: Pane, scene: SceneState) -> None:
        """How many robots are in which state, in places that do not move, and in runs with tasks how many are done."""
        u, counts = self.unit, np.bincount(scene.state, minlength=5)
        x, y = pane.left, pane.bottom + pane.foot_px - 28 * u
        room = len(str(pane.scene.record.fleet.num_robots)) * font(round(18 * u), True).getlength("0")
        tasks = pane.scene.tasks_at(scene.t_s)
        for state, name in enumerate(state_names(tasks is not None)):
            self.canvas.fill(_rectangle(x, y - 8 * u, 16 * u, 16 * u), STATES[state])
            self.canvas.write(str(counts[state]), (x + 24 * u + room, y), 18 * u, LIGHT["ink"], bold=True, align="right")
            self.canvas.write(name, (x + 32 * u + room, y), 18 * u, LIGHT["muted"])
            x += 58 * u + room + font(round(18 * u)).getlength(name)
        if tasks is not None:
            self.canvas.write(f"{tasks[0]} orders done, {tasks[1]} open", (x, y), 18 * u, LIGHT["ink"])

    def _track(self, pane: Pane) -> tuple[Pixels, Pixels]:
        """How many robots are in which state at every time: what has been, and paler, what is to come."""
        width, height = round(pane.width), round(20 * self.unit)
        t_s = np.linspace(self.timing.from_s, self.timing.to_s, width)
        sample = np.clip(np.searchsorted(pane.scene.record.execution.t_s, t_s), 0, len(pane.scene.state) - 1)
        share = np.stack([(pane.scene.state[sample] == state).mean(axis=1) for state in (AT_GOAL, 0, 1, BLOCKED, ABSENT)])
        edge = height * np.cumsum(share, axis=0)
        row = np.arange(height)[::-1, None] + 0.5
        index = np.minimum((row[None] > edge[:, None]).sum(axis=0), 4)
        palette = np.array([to_rgba(STATES[state]) for state in (AT_GOAL, 0, 1, BLOCKED, ABSENT)]) * 255
        past = palette[index].round().astype(np.uint8)
        past[:, t_s > pane.scene.end_s + 1e-9, 3] = 0
        paler = past.copy()
        paler[..., 3] = (past[..., 3] * 0.28).astype(np.uint8)
        return past, paler

    def _draw_track(self, pane: Pane, t_s: float) -> None:
        past, to_come = self.tracks[self.panes.index(pane)]
        timing, u = self.timing, self.unit
        share = (t_s - timing.from_s) / max(1e-9, timing.to_s - timing.from_s)
        at, left, bottom = round(share * past.shape[1]), round(pane.left), round(pane.bottom)
        self.canvas.paste(past[:, :at], left, bottom)
        self.canvas.paste(to_come[:, at:], left + at, bottom)
        self.canvas.fill(_rectangle(left + at - 1.5 * u, bottom - 4 * u, 3 * u, past.shape[0] + 8 * u), LIGHT["ink"])


def clock(t_s: float) -> str:
    """Minutes, seconds and tenths; hours where there are any."""
    tenths = round(t_s * 10)
    minutes, tenths = divmod(tenths, 600)
    hours, minutes = divmod(minutes, 60)
    text = f"{minutes:02d}:{tenths // 10:02d}.{tenths % 10}" if hours else f"{minutes}:{tenths // 10:02d}.{tenths % 10}"
    return f"{hours}:{text}" if hours else text


def _panes(scenes: Sequence[Scene], size: tuple[int, int], unit: float) -> list[Pane]:
    """Runs beside each other or on top, whichever shows them larger."""
    margin, gap = 40 * unit, 48 * unit
    best: list[Pane] = []
    for columns in range(1, len(scenes) + 1):
        rows = math.ceil(len(scenes) / columns)
        width = (size[0] - 2 * margin - (columns - 1) * gap) / columns
        height = (size[1] - 24 * unit - 30 * unit - (rows - 1) * gap / 2) / rows
        panes = [
            Pane(
                scene=scene,
                left=margin + (k % columns) * (width + gap),
                bottom=30 * unit + (rows - 1 - k // columns) * (height + gap / 2),
                width=width,
                height=height,
                title_px=86 * unit,
                foot_px=74 * unit,
                unit=unit,
            )
            for k, scene in enumerate(scenes)
        ]
        if not best or min(p.scale for p in panes) > min(p.scale for p in best):
            best = panes
    return best


def _draw_robots(canvas: Canvas, pane: Pane, now: SceneState) -> None:
    scene, u = pane.scene, pane.unit
    clip = pane.clip
    xy = pane.pixels(now.xy)
    is_shown = ((xy >= pane.corner) & (xy <= pane.corner + pane.size)).all(axis=1)  # and not on another level
    there = np.flatnonzero((now.state != ABSENT) & is_shown)
    everybody = np.ones(len(scene.chosen), np.bool_)
    planned = scene.chosen if scene.has_choice else everybody & (len(everybody) <= PLANNED)
    breadth = float(np.median(pane.body[:, 1]))
    for state in range(4):
        lines = []
        for robot in there[(now.state[there] == state) & planned[there]].tolist():
            ahead = scene.ahead(robot, now)
            if len(ahead) and np.abs(ahead - now.xy[robot]).max() > 0.05:
                lines.append(np.concatenate([xy[robot : robot + 1], pane.pixels(ahead)]))
        canvas.stroke(lines, STATES[state], alpha=0.32, width=max(2 * u, 0.28 * breadth), clip=clip)
        ends = np.array([line[-1] for line in lines]).reshape(-1, 1, 2)
        canvas.fill(ends + _disc(max(3 * u, 0.24 * breadth)), STATES[state], alpha=0.75, clip=clip)
    waits = [(a, b) for a, b in scene.waited_for(now) if is_shown[a] and is_shown[b]]
    for state in (1, 2):
        lines = [xy[[a, b]] for a, b in waits if now.state[a] == state]
        canvas.stroke(lines, STATES[state], alpha=0.85, width=(2 if pane.few else 1.4) * max(0.7, u), clip=clip)
    turn = _turns(now.yaw_rad)
    pale = ~scene.chosen if scene.has_choice else ~everybody
    _draw_parts(canvas, pane, now, np.isin(scene.parts.owner, there), pale)
    blocked = there[now.state[there] == BLOCKED]
    reach = 0.5 * np.hypot(*pane.body.T)
    rings = [xy[r] + _disc(reach[r] + 4 * u)[[*range(16), 0]] for r in blocked] if len(blocked) <= RINGED else []
    canvas.stroke(rings, STATES[BLOCKED], width=2.5 * u, alpha=0.8, clip=clip)
    front = NOSE if pane.inside_px else ARROW
    for state in range(4):
        for faint in (True, False):
            members = there[(now.state[there] == state) & (pale[there] == faint)]
            body = (BOX * pane.body[members, None]) @ turn[members] + xy[members, None]
            canvas.fill(body, STATES[state], clip=clip, edge=LIGHT["ink"], width=_edge(pane), alpha=0.3 if faint else 1.0)
            canvas.fill((front * pane.body[members, None]) @ turn[members] + xy[members, None], "#ffffff", clip=clip)
            forked = members[scene.forks[members] != 0]
            end = np.stack([scene.forks[forked], np.ones(len(forked))], 1)[:, None]
            for fork in FORKS:
                canvas.fill((fork * end * pane.body[forked, None]) @ turn[forked] + xy[forked, None], LIGHT["ink"], clip=clip)
    if pane.inside_px:
        for robot in there[~pale[there]].tolist():
            back = xy[robot] - 0.1 * pane.body[robot, 0] * turn[robot, 0]
            canvas.write(scene.name[robot], back, pane.inside_px, "#ffffff", bold=True, align="center")
    elif pane.few or scene.has_choice:
        _write_names(canvas, pane, xy, there[~pale[there]], reach)


def _draw_parts(canvas: Canvas, pane: Pane, now: SceneState, is_shown: BoolArray, pale: BoolArray) -> None:
    """Draw trailers with their drawbars, and loads that are larger than their robots, below these."""
    parts, clip = pane.scene.parts, pane.clip
    there = np.flatnonzero(is_shown & np.isfinite(now.parts_xy[:, 0]))
    bars = [pane.pixels(line) for k, line in drawbars(parts, now.parts_xy, now.parts_yaw_rad, now.xy) if is_shown[k]]
    canvas.stroke(bars, LIGHT["ink"], width=max(1.2 * pane.unit, 0.08 * pane.scale), clip=clip)
    shape = BOX * (np.column_stack((parts.length_m, parts.width_m)) * pane.scale)[:, None]
    boxes = shape @ _turns(now.parts_yaw_rad) + pane.pixels(now.parts_xy)[:, None]
    for k in there.tolist():
        robot = parts.owner[k]
        alpha = 0.3 if pale[robot] else 1.0
        canvas.fill(boxes[k : k + 1], STATES[now.state[robot]], clip=clip, edge=LIGHT["ink"], width=_edge(pane), alpha=alpha)


def _edge(pane: Pane) -> float:
    """Width of the line around a body, px."""
    return max(0.6, (1.2 if pane.few else 0.8) * pane.unit)


def _turns(yaw_rad: FloatArray) -> FloatArray:
    """[N, 2, 2] what turns rows from along bodies into those along the axes."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.stack([np.stack([c, s], -1), np.stack([-s, c], -1)], -2)


def _write_names(canvas: Canvas, pane: Pane, xy: FloatArray, robots: IntArray, reach: FloatArray) -> None:
    """Names beside robots, each where it was in the frame before unless it would now cover another name or robot there."""
    u = pane.unit
    size = max(10.0, 14 * u)
    face = font(round(size), True)
    half = np.array([(face.getlength(name) / 2 + 2, 0.6 * size) for name in pane.scene.name])
    taken: list[tuple[FloatArray, FloatArray]] = []  # middles of names, and half their sizes
    for robot in robots.tolist():
        others = xy[robots[robots != robot]]
        for choice in dict.fromkeys((int(pane.place[robot]), *range(len(PLACES)))):
            direction = np.array(PLACES[choice])
            at = xy[robot] + direction * (reach[robot] * (0.75 if direction.all() else 1) + 2 * u + half[robot])
            covers = any((np.abs(at - other) < half[robot] + of_other).all() for other, of_other in taken)
            if not covers and not (np.abs(others - at) < half[robot] + 0.5 * float(reach[robot])).all(axis=1).any():
                pane.place[robot] = choice
                taken.append((at, half[robot]))
                canvas.write(pane.scene.name[robot], tuple(at), size, LIGHT["ink"], bold=True, halo=LIGHT["halo"], align="center")
                break


def _rectangle(left: float, bottom: float, width: float, height: float) -> FloatArray:
    """[1, 4, 2]"""
    return np.array([[(left, bottom), (left + width, bottom), (left + width, bottom + height), (left, bottom + height)]])


def _disc(radius: float) -> FloatArray:
    """[16, 2]"""
    angle = np.arange(16) * (np.pi / 8)
    return radius * np.column_stack((np.cos(angle), np.sin(angle)))
