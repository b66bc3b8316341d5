"""Codes and colours that the page's scripts, its style sheet and stills share.

The scripts import them from `constants.js`, which is not a file: `constants_module()` writes it into the page.
"""

import json
from collections.abc import Mapping

from mrp_sumo.io import record
from mrp_sumo.reports.pictures.view import ABSENT

NEVER = 2**32 - 1  # in columns of times and of indices
OFF_THE_FLOOR = "not on the floor"  # a state
_COLOURS = {  # by name: light, dark
    "paper": ("#eef1f5", "#0c1015"),
    "floor": ("#ffffff", "#171f29"),
    "furniture": ("#e6ebf1", "#232c37"),
    "fine": ("#aab4c0", "#465260"),
    "hole": ("#e2e7ee", "#0f141a"),
    "wall": ("#3a4454", "#8a97a8"),
    "lane": ("#b9c7d8", "#324154"),
    "door": ("#c2813f", "#b98a55"),
    "station": ("#7b8da3", "#5d7085"),
    "special": ("#7c5cd6", "#a48df0"),  # a station with a purpose
    "ink": ("#17202c", "#e6edf3"),
    "muted": ("#5b6878", "#95a2b2"),
    "halo": ("#ffffff", "#0c1015"),
    "accent": ("#1d4ed8", "#6ea8ff"),
    "moving": ("#2f7de1", "#4d9bff"),
    "waiting": ("#e8960c", "#f7b02e"),
    "blocked": ("#dc2f45", "#ff5468"),
    "goal": ("#15936f", "#2fc597"),
    "absent": ("#9aa5b1", "#667380"),
    "person": ("#9d3f8f", "#e39bd6"),
}
THEMES: Mapping[str, Mapping[str, str]] = {
    theme: {name: pair[k] for name, pair in _COLOURS.items()} for k, theme in enumerate(("light", "dark"))
}
STATE_COLOURS = ("moving", "waiting", "blocked", "goal", "absent")  # in a theme, by state


def constants_module() -> str:
    """The text of `constants.js`."""
    values: dict[str, object] = {name: getattr(record, name) for name in ("MOVING", "WAITING", "BLOCKED", "AT_GOAL")}
    values |= {"ABSENT": ABSENT, "STATE_COLORS": STATE_COLOURS, "NEVER": NEVER, "THEMES": THEMES}
    return "".join(f"export const {name} = {json.dumps(value)};\n" for name, value in values.items())


def css_variables(theme: str) -> str:
    """Declarations of a theme's colours, `--paper: #eef1f5; ...`."""
    return " ".join(f"--{name}: {colour};" for name, colour in THEMES[theme].items())
