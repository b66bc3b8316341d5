"""Put what `mrp-sumo paper` wrote into docs/paper.md.

    mrp-sumo paper --out runs/paper_own --maps MRP_BENCH
    python tools/paper_page.py mrp_bench=runs/paper_own

What stands between `<!-- NAME -->` and `<!-- end -->` is replaced by the sections in SECTIONS; their figures are copied to
docs/figures/NAME_*.svg. All sections are in the command's own index.html.
"""

import re
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE = DOCS / "paper.md"
SECTIONS = {  # which the page shows, by campaign
    "mrp_bench": ("Table III: execution", "Table IV: makespan and cost"),
}


def main() -> None:
    """Write the page."""
    if not sys.argv[1:] or any("=" not in word for word in sys.argv[1:]):
        sys.exit(__doc__)
    text = PAGE.read_text(encoding="utf-8")
    for name, folder in (word.split("=", 1) for word in sys.argv[1:]):
        begin, middle, rest = text.partition(f"<!-- {name} -->\n")
        if not middle:
            sys.exit(f"{PAGE.name} has no place for '{name}'")
        text = begin + middle + "\n" + _block(name, Path(folder)) + "\n<!-- end -->" + rest.partition("<!-- end -->")[2]
    PAGE.write_text(text, encoding="utf-8")


def _block(name: str, folder: Path) -> str:
    """The Markdown of a campaign, its figures copied beside the page."""

    def copied(link: re.Match[str]) -> str:
        file = f"figures/{name}_{link[1]}.svg"
        (DOCS / file).write_bytes((folder / "figures" / f"{link[1]}.svg").read_bytes())
        return f"]({file})"

    return re.sub(r"\]\(figures/(\w+)\.svg\)", copied, shown(name, (folder / "paper.md").read_text(encoding="utf-8")))


def shown(name: str, text: str) -> str:
    """The sections of a campaign's Markdown that the page shows."""
    sections = re.split(r"^(?=### )", text, flags=re.MULTILINE)
    return "".join(section for section in sections if section.partition("\n")[0].removeprefix("### ") in SECTIONS[name])


if __name__ == "__main__":
    main()
