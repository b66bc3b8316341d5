"""Rules that options of several commands keep: what is out of range, or has no effect beside the others, is refused and never ignored."""

from mrp_sumo.errors import MrpSumoError


def require_least(option: str, value: int | None, least: int) -> None:
    """Refuse a number that is too small."""
    if value is not None and value < least:
        raise MrpSumoError(f"{option}: found {value}, expected {least} or more")


def port_number(text: str) -> int:
    """The type of an argument that is a port to listen at; 0 is any free one."""
    if not (text.isascii() and text.isdecimal()) or int(text[:6]) > 65535:
        raise MrpSumoError(f"--port: found {text[:40]!r}, expected a whole number up to 65535")
    return int(text)


def only_for(what: str, **options: object) -> None:
    """Refuse the first option that is said, since it is for something else.

    Parameters
    ----------
    what
        The options are for, such as `--video`.
    options
        Values by names; None, False and () where the option is not said.
    """
    for name, value in options.items():
        if value is not None and value is not False and value != () and value != []:
            raise MrpSumoError(f"--{name.strip('_').replace('_', '-')} is for {what}")
