"""What is installed is locked: exact versions, each with the hashes of its files."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LOCKS = ("build", "docs", "run", "test")


def plain(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def locked(name):
    """Version and number of hashes of every package."""
    text = (ROOT / "requirements" / f"{name}.txt").read_text()
    parts = re.split(r"^(?=\S)", text, flags=re.MULTILINE)
    result = [(re.match(r"([\w.-]+)==([^\s;\\]+)", part), part.count("--hash=sha256:")) for part in parts if part.strip()]
    return {plain(match[1]): (match[2], hashes) for match, hashes in result}


def test_every_locked_version_is_that_of_the_constraints_and_has_hashes():
    pins = dict(line.split("==") for line in (ROOT / "constraints.txt").read_text().split())
    constrained = {plain(name): version for name, version in pins.items()}
    together = {}
    for name in LOCKS:
        for package, (version, hashes) in locked(name).items():
            assert hashes, f"{package} in requirements/{name}.txt has no hash"
            assert constrained.get(package) == version, f"{package} {version} in requirements/{name}.txt: run tools/lock.sh"
            together[package] = version
    assert set(constrained) == set(together), "constraints.txt has others than requirements/: run tools/lock.sh"


def test_every_dependency_is_locked():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = dict(project["optional-dependencies"])
    docs = project["dependencies"] + extras.pop("docs")
    test = project["dependencies"] + [need for needs in extras.values() for need in needs]
    for needs, name in ((project["dependencies"], "run"), (docs, "docs"), (test, "test")):
        wanted = {plain(re.match(r"[\w.-]+", need)[0]) for need in needs}
        assert wanted <= set(locked(name)), f"requirements/{name}.txt lacks {wanted - set(locked(name))}: run tools/lock.sh"
