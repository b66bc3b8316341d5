"""Rules that options of several commands keep: what is out of range, or has no effect beside the others, is refused and never ignored."""

import argparse
import math
import re
import sys

from mrp_sumo.errors import MrpSumoError


def require_least(option: str, value: float | None, least: float) -> None:
    """Refuse a number that is too small, or no number."""
    require_within(option, value, least, expected=f"{least:g} or more")


def require_within(option: str, value: float | None, least: float, most: float = sys.float_info.max, *, expected: str = "") -> None:
    """Refuse a number outside of limits, or no number; None is not said."""
    if value is not None and not least <= value <= most:
        number = f"{value:g}" if isinstance(value, float) else value
        raise MrpSumoError(f"{option}: found {number}, expected {expected or f'{least:g} to {most:g}'}")


def share(option: str, text: str, least: float, most: float) -> float:
    """A share, written as `0.5` or `50%`. Raises MrpSumoError outside of limits, or for what is no share."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?|\.\d+)\s*(%?)", text)
    value = float(match[1]) / (100 if match[2] else 1) if match else -1.0
    if not least <= value <= most:
        raise MrpSumoError(f"{option}: found {text[:40]!r}, expected a share from {least:g} to {most:g}, such as 0.5 or 50%")
    return value


def port_number(text: str) -> int:
    """The type of an argument that is a port to listen at; 0 is any free one."""
    if not (text.isascii() and text.isdecimal()) or int(text[:6]) > 65535:
        raise MrpSumoError(f"--port: found {text[:40]!r}, expected a whole number up to 65535")
    return int(text)


def scale(text: str) -> float:
    """The type of an argument that is metres a pixel, or two places in pixels and the metres between them."""
    places, equals, metres = text.partition("=")
    if not equals:
        return above_0(text)
    try:
        (ax, ay), (bx, by) = (map(float, place.split(",")) for place in places.split(":"))
        pixels = math.dist((ax, ay), (bx, by))
    except ValueError:
        raise argparse.ArgumentTypeError(f"found '{text}', expected X,Y:X,Y=M, such as 120,80:920,80=20") from None
    if not 0 < pixels < math.inf:
        raise argparse.ArgumentTypeError(f"found '{text}', expected two places that are apart")
    return above_0(metres) / pixels


def above_0(text: str) -> float:
    """The type of an argument that is a number above 0."""
    try:
        number = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"found '{text}', expected a number") from None
    if not 0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"found {text}, expected more than 0")
    return number


def only_for(what: str, **options: object) -> None:
    """Refuse the first option that is said, since it is for something else, such as `--video`; None, False, () and [] are not said."""
    for name, value in options.items():
        if value not in (None, (), []) and value is not False:
            raise MrpSumoError(f"--{name.strip('_').replace('_', '-')} is for {what}")
