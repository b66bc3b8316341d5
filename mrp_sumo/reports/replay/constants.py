"""Codes and colours that the page's scripts, its style sheet and stills share.

The scripts import them from `constants.js`, which is not a file: `constants_module()` writes it into the page.
"""

import json
from collections.abc import Mapping

from mrp_sumo.io import record
from mrp_sumo.reports.pictures.view import ABSENT

NEVER = 2**32 - 1  # in columns of times and of indices
OFF_THE_FLOOR = "not on the floor"  # a state
THEMES: Mapping[str, Mapping[str, str]] = {
    "light": {
        "paper": "#eef1f5",
        "floor": "#ffffff",
        "furniture": "#e6ebf1",
        "fine": "#aab4c0",
        "hole": "#e2e7ee",
        "wall": "#3a4454",
        "lane": "#b9c7d8",
        "door": "#c2813f",
        "station": "#7b8da3",
        "special": "#7c5cd6",  # a station with a purpose
        "ink": "#17202c",
        "muted": "#5b6878",
        "halo": "#ffffff",
        "accent": "#1d4ed8",
        "moving": "#2f7de1",
        "waiting": "#e8960c",
        "blocked": "#dc2f45",
        "goal": "#15936f",
        "absent": "#9aa5b1",
        "person": "#9d3f8f",
    },
    "dark": {
        "paper": "#0c1015",
        "floor": "#171f29",
        "furniture": "#232c37",
        "fine": "#465260",
        "hole": "#0f141a",
        "wall": "#8a97a8",
        "lane": "#324154",
        "door": "#b98a55",
        "station": "#5d7085",
        "special": "#a48df0",
        "ink": "#e6edf3",
        "muted": "#95a2b2",
        "halo": "#0c1015",
        "accent": "#6ea8ff",
        "moving": "#4d9bff",
        "waiting": "#f7b02e",
        "blocked": "#ff5468",
        "goal": "#2fc597",
        "absent": "#667380",
        "person": "#e39bd6",
    },
}
STATE_COLOURS = ("moving", "waiting", "blocked", "goal", "absent")  # in a theme, by state


def constants_module() -> str:
    """The text of `constants.js`."""
    values = {
        "MOVING": record.MOVING,
        "WAITING": record.WAITING,
        "BLOCKED": record.BLOCKED,
        "AT_GOAL": record.AT_GOAL,
        "ABSENT": ABSENT,
        "STATE_COLORS": STATE_COLOURS,
        "NEVER": NEVER,
        "THEMES": THEMES,
    }
    return "".join(f"export const {name} = {json.dumps(value)};\n" for name, value in values.items())


def css_variables(theme: str) -> str:
    """Declarations of a theme's colours, `--paper: #eef1f5; ...`."""
    return " ".join(f"--{name}: {colour};" for name, colour in THEMES[theme].items())
