"""Build the documentation's site: run what its pages show, add the runs that they embed, and have mkdocs put it together.

    ./tools/docs.sh                        # site/; its search needs a server: python -m http.server --directory site
    ./tools/docs.sh --check [try.md ...]   # only run what the pages show
    ./tools/docs.sh --build                # only build the site

The pages of TUTORIALS are followed as a reader follows them, on a machine without a display, in an empty folder and in the order of the
page: code blocks with a title are files, `bash` blocks are commands, which must end with exit code 0, and `python` blocks are one script.
Commands are those of the Python that runs this file, so that the same pages are followed in a clone and from the wheel. Python and plug-ins
of other pages are run by the tests (tests/door/test_front.py, tests/test_documented_plug_ins.py), notebooks by mkdocs-jupyter. A dead link
or anchor ends the build.
"""

import argparse
import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
DOCS, SITE = PROJECT / "docs", PROJECT / "site"
README = "README.md"
TUTORIALS = (
    *(README, "try.md", "maps.md", "robots.md", "own_planner.md", "own_plugins.md", "capacity.md", "compare.md", "scenario.md", "faq.md"),
    *("integrator.md", "fleet_manager.md", "lifelong.md"),
)
EMBEDDED = {  # replay page -> scenario and options
    "office_5": ("office_5",),
    "office_9": ("office_9",),
}
BLOCK = re.compile(r'^```(\w+)(?: title="([^"]+)")?\n(.*?)^```$', re.MULTILINE | re.DOTALL)


def main() -> int:
    """Run, add, build. Exit code 1 when something that a page shows does not work."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", nargs="*", metavar="PAGE", help="only run what the pages show, all or these")
    parser.add_argument("--build", action="store_true", help="only build the site, and do not run what the pages show")
    options = parser.parse_args()
    pages = () if options.build else options.check or TUTORIALS
    failed = [line for page in pages for line in followed(page)]
    for line in failed:
        print(f"docs: {line}", file=sys.stderr)
    if failed or options.check is not None:
        return 1 if failed else 0
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "docs"
        shutil.copytree(DOCS, folder)
        add_runs(folder / "runs", Path(scratch))
        make_notebooks(folder / "notebooks")
        environment = {**os.environ, "MRP_SUMO_DOCS": str(folder), "PYTHONPATH": str(PROJECT), "NO_MKDOCS_2_WARNING": "1"}
        command = [
            sys.executable,
            "-m",
            "mkdocs",
            "build",
            "--quiet",
            "--clean",
            "--config-file",
            str(PROJECT / "mkdocs.yml"),
            "--site-dir",
            str(SITE),
        ]
        return subprocess.run(command, env=environment, cwd=PROJECT).returncode


def followed(page: str) -> list[str]:
    """Follow a page. Returns a line for each thing that does not work. What it leaves running in the background ends with it."""
    script, wrong, groups = "", [], []
    with tempfile.TemporaryDirectory() as place:
        for language, title, text in BLOCK.findall((PROJECT / page if page == README else DOCS / page).read_text(encoding="utf-8")):
            if title:
                Path(place, title).write_text(text, encoding="utf-8")
            elif language == "bash":
                wrong += [
                    f"{page}: `{line}`: {why}" for line in text.splitlines() if line.strip() and (why := why_not(line, place, groups))
                ]
            elif language == "python":
                script += text
        if script:
            Path(place, "page.py").write_text(script, encoding="utf-8")
            if why := why_not("python page.py", place, groups):
                wrong.append(f"{page}: its Python: {why}")
        for group in groups:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(group, signal.SIGTERM)
    return wrong


def why_not(line: str, place: str, groups: list[int]) -> str:
    """Run a command as a reader does, in a process group of its own, which is noted. Returns why it failed, '' if it did not."""
    print(f"docs: {line}", flush=True)
    environment = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    environment |= {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}", "BROWSER": "true"}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(["bash", "-c", line], cwd=place, env=environment, start_new_session=True, **pipes) as process:
        groups.append(process.pid)
        output, errors = process.communicate()
    said = (errors.strip() or output.strip()).splitlines()
    return f"exit code {process.returncode}: {said[-1] if said else ''}" if process.returncode else ""


def add_runs(pages: Path, scratch: Path) -> None:
    """Make the runs whose replay pages are embedded."""
    pages.mkdir()
    for name, (scenario, *options) in EMBEDDED.items():
        out = scratch / "made" / name
        command = [sys.executable, "-m", "mrp_sumo", "run", scenario, *options, "--out", str(out), "--replay"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env={**os.environ, "PYTHONPATH": str(PROJECT)})
        shutil.move(out / "replay.html", pages / f"{name}.html")


def make_notebooks(folder: Path) -> None:
    """Turn the scripts of `folder`, text and code by turns, into notebooks; mkdocs-jupyter executes them."""
    import jupytext

    for script in sorted(folder.glob("*.py")):
        jupytext.write(jupytext.read(script, fmt="py:percent"), script.with_suffix(".ipynb"))
        script.unlink()


if __name__ == "__main__":
    sys.exit(main())
