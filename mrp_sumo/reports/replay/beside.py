"""Two runs in one page, on one clock: their replay pages beside each other, and a table of what differs between them."""

import html
from pathlib import Path

from mrp_sumo.reports.pictures.view import AnyRun
from mrp_sumo.reports.replay.constants import css_variables
from mrp_sumo.reports.replay.page import About, filled, replay_page, shown


def page_of_two(first: AnyRun, second: AnyRun) -> str:
    """The page. Raises MrpSumoError where the folder of one is damaged or there is nothing to replay."""
    both = [shown(run) for run in (first, second)]
    abouts, pages = [about for _, about in both], [replay_page(*each) for each in both]
    titles = [about.name for about in abouts]
    if titles[0] == titles[1]:
        titles = [Path(run.source).name for run in (first, second)]
    return filled(
        Path(__file__).with_name("beside.html"),
        title=html.escape(f"{titles[0]} beside {titles[1]}"),
        light=css_variables("light"),
        dark=css_variables("dark"),
        first=html.escape(titles[0]),
        second=html.escape(titles[1]),
        differences=_differences(*abouts),
        frames="".join(
            f'<iframe title="{html.escape(title)}" srcdoc="{html.escape(page)}"></iframe>' for title, page in zip(titles, pages)
        ),
    )


def _differences(first: About, second: About) -> str:
    """Rows of what both say of themselves and is not the same; the lines of the first come first."""
    one, two = ({**dict(about.facts), **dict(about.metrics)} for about in (first, second))
    rows = []
    for name in dict.fromkeys([*one, *two]):
        a, b = one.get(name, "–"), two.get(name, "–")
        if a != b:
            rows.append(f"<tr><th scope=row>{html.escape(name)}</th><td>{html.escape(a)}</td><td>{html.escape(b)}</td></tr>")
    return "".join(rows)
