"""A page that leads to other pages: what each shows, a picture of it, and the command that goes on from there."""

import html
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

STYLE_SHEET = Path(__file__).with_suffix(".css")
TITLE, LEAD = "mrp_sumo in a minute", "Made on this machine just now. Each page stands alone: open it, send it, keep it."


@dataclass(frozen=True)
class TourPage:
    """One of the pages that are led to."""

    title: str
    text: str
    page: str  # relative
    picture: str = ""  # relative
    command: str = ""
    links: tuple[tuple[str, str], ...] = ()  # names and relative addresses of what belongs to it


def tour_page(stops: Sequence[TourPage]) -> str:
    """The page as text; everything from outside is escaped."""
    articles = []
    for stop in stops:
        text = {name: html.escape(value) for name, value in vars(stop).items() if isinstance(value, str)}
        picture = f'<a href="{text["page"]}"><img src="{text["picture"]}" alt="{text["title"]}"></a>' if stop.picture else ""
        command = f"<code>{text['command']}</code>" if stop.command else ""
        named = ", ".join(f'<a href="{html.escape(address)}">{html.escape(name)}</a>' for name, address in stop.links)
        links = f'<p class="lead">{named}</p>' if named else ""
        head = f'<h2><a href="{text["page"]}">{text["title"]}</a></h2>'
        articles.append(f"<article>{picture}<div>{head}<p>{text['text']}</p>{command}{links}</div></article>")
    lines = [
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n<link rel="icon" href="data:,">',
        f"<title>{TITLE}</title>\n<style>\n{STYLE_SHEET.read_text(encoding='utf-8')}</style>\n</head>\n<body>",
        f'<header><h1>{TITLE}</h1><p class="lead">{LEAD}</p></header>',
        "<main>",
        *articles,
        "</main>\n</body>\n</html>\n",
    ]
    return "\n".join(lines)
