"""Put what `mrp-sumo paper` wrote into docs/paper.md.

    mrp-sumo paper --out runs/paper
    mrp-sumo paper --out runs/paper_own --maps MRP_BENCH
    python tools/paper_page.py bundled=runs/paper mrp_bench=runs/paper_own

What stands between `<!-- NAME -->` and `<!-- end -->` is replaced; figures are copied to docs/figures/NAME_*.svg.
"""

import re
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE = DOCS / "paper.md"


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

    def copied(found: re.Match[str]) -> str:
        file = f"figures/{name}_{found[1]}.svg"
        (DOCS / file).write_bytes((folder / "figures" / f"{found[1]}.svg").read_bytes())
        return f"]({file})"

    return re.sub(r"\]\(figures/(\w+)\.svg\)", copied, (folder / "paper.md").read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
