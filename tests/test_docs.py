"""What the documents say is so: commands and options exist, links lead somewhere, pictures of the house match its tests."""

import argparse
import re
import shlex
from dataclasses import dataclass, fields
from importlib import import_module
from pathlib import Path

import pytest
import yaml
from test_architecture import FLOORS, tool

from mrp_sumo.cli.main import COMMANDS
from mrp_sumo.core.driving import Planning
from mrp_sumo.core.options import option
from mrp_sumo.io.documents import declared_in, keys_of
from mrp_sumo.io.scenario.execution import ExecutionChoice
from mrp_sumo.io.scenario.model import ScenarioModel
from planners import PLUGINS

PROJECT = Path(__file__).resolve().parents[1]
DOCUMENTS = [*(PROJECT / name for name in ("README.md", "CONTRIBUTING.md")), *sorted((PROJECT / "docs").glob("*.md"))]


def commands_in(text):
    """Every `mrp-sumo ...` of code blocks, indented blocks and inline code."""
    lines = re.findall(r"^(?: {4})?(?:\$ )?(?:\.venv/bin/)?(mrp-sumo .+)$", text, re.M)
    lines += re.findall(r"`(mrp-sumo [^`\n]+)`", text)
    return list(dict.fromkeys(line for line in lines))


def parser_of(name):
    parser = argparse.ArgumentParser()
    import_module(COMMANDS[name][0]).arguments(parser)
    return parser


def options_of(parser):
    for action in parser._actions:
        yield from action.option_strings
        if isinstance(action, argparse._SubParsersAction):
            for inner in action.choices.values():
                yield from options_of(inner)


def ask(line):
    """Name and options of a command line as it stands in a document: without a comment, brackets of what is optional, alternatives."""
    words = shlex.split(re.sub(r"\s#.*", "", line).replace("[", " ").replace("]", " "))
    return words[1], [word.split("=")[0] for word in words[2:] if re.match(r"--?[a-zA-Z]", word)]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_every_documented_command_and_option_exists(path):
    wrong = []
    for line in commands_in(path.read_text(encoding="utf-8")):
        name, options = ask(line)
        if name.startswith("-") or name == "COMMAND":
            continue
        if name not in COMMANDS:
            wrong.append(f"{line}: no command '{name}'")
            continue
        known = set(options_of(parser_of(name)))
        wrong += [f"{line}: no option '{option}'" for option in options if option not in known]
    assert not wrong, "\n".join(wrong)


def test_options_are_looked_for_in_every_way_that_documents_write_them():
    text = "    mrp-sumo analyze BAG [--json]\n`mrp-sumo run X --gui`\n```\nmrp-sumo export RUN --csv | --fcd   # --not-this\n```\n"
    assert [ask(line) for line in commands_in(text)] == [("analyze", ["--json"]), ("export", ["--csv", "--fcd"]), ("run", ["--gui"])]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_to_files_and_headings(path):
    text = path.read_text(encoding="utf-8")
    wrong = []
    for target in re.findall(r"\]\((?!https?:)([^)\s]+)\)", text):
        name, _, heading = target.partition("#")
        file = (path.parent / name).resolve() if name else path
        if file.suffix == ".ipynb":  # made of a script when the site is built
            file = file.with_suffix(".py")
        if not file.exists():
            wrong.append(target)
        elif heading:
            titles = re.findall(r"^#+ (.+)$", file.read_text(encoding="utf-8"), re.M)
            if heading not in {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}:
                wrong.append(target)
    assert not wrong, wrong


def test_every_document_is_listed_in_the_readme():
    readme = (PROJECT / "README.md").read_text(encoding="utf-8")
    missing = [path.name for path in DOCUMENTS[1:] if f"({path.relative_to(PROJECT).as_posix()})" not in readme]
    assert not missing


def test_the_page_on_architecture_draws_the_floors_of_the_test():
    text = (PROJECT / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = re.findall(r"^\| (\d+) \| (.+?) \|", text, re.M)
    drawn = [set(re.findall(r"`(\w+)`", rooms)) - {"planners"} for _, rooms in sorted(table, key=lambda row: int(row[0]))]
    assert tuple(drawn) == FLOORS


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_tables_of_the_pages_are_what_the_code_makes(path):
    text = path.read_text(encoding="utf-8")
    assert text == tool("doc_tables").with_tables(text)


def test_every_parameter_of_planners_is_explained():
    text = (PROJECT / "docs" / "planners.md").read_text(encoding="utf-8").split("| parameter | meaning |")[1]
    explained = set(re.findall(r"`(\w+)`", " ".join(re.findall(r"^\| (`.+?) \|", text, re.M))))
    for name, where in PLUGINS["planners"].items():
        module, _, kind = where.partition(":")
        assert {field.name for field in fields(getattr(import_module(module), kind))} <= explained, name


def without_a_sentence(keys):
    """Dotted names of keys that say nothing about themselves."""
    return [name for name, field in keys if not field.description]


def test_every_section_of_scenarios_has_a_table_and_every_key_a_sentence():
    tables = tool("doc_tables")
    text = (PROJECT / "docs" / "keys.md").read_text(encoding="utf-8")
    sections = [name for name, field in keys_of(ScenarioModel).items() if any(declared_in(field.annotation))]
    assert re.findall(r"^<!-- table: keys_?(\w*) -->$", text, re.M) == ["", *sections]
    assert [key for section in ("", *sections) for key in without_a_sentence(tables.keys_in(section))] == []


def test_key_without_a_sentence_is_noticed_and_a_new_key_changes_the_page(monkeypatch):
    @dataclass(frozen=True)
    class More(Planning):
        flux: float = option(0.0)

    monkeypatch.setattr(keys_of(ExecutionChoice)["planning"], "annotation", More)
    tables = tool("doc_tables")
    assert without_a_sentence(tables.keys_in("execution")) == ["execution.planning.flux"]
    assert "`execution.planning.flux`" in tables.with_tables("<!-- table: keys_execution -->\n<!-- end -->")


EXAMPLES = ("name", "map.file", "robots.count", "robots.starts", "robots.goals", "execution.policy")


def test_documented_defaults_are_those_of_the_code():
    block = re.search(r"^```yaml\n(name:.*?)^```$", (PROJECT / "docs" / "scenario.md").read_text(encoding="utf-8"), re.M | re.S)[1]
    shown = yaml.safe_load(block)
    code = ScenarioModel.model_validate({"map": "office", "robots": 9}).model_dump(mode="json")
    assert list(differing(shown, code)) == []
    shown["execution"]["goal_tolerance_m"] = 0.5
    assert list(differing(shown, code)) == ["execution.goal_tolerance_m"]


def differing(shown, code, above=""):
    """Dotted keys whose value on the page is not the code's."""
    for name, value in shown.items():
        if above + name in EXAMPLES or name == "dispatcher":
            continue
        if isinstance(value, dict) and isinstance(code[name], dict) and value:
            yield from differing(value, code[name], f"{above}{name}.")
        elif value != code[name]:
            yield above + name


def pages_of_the_index():
    """The page that each row of the table in docs/index.md leads to first."""
    text = (PROJECT / "docs" / "index.md").read_text(encoding="utf-8")
    return re.findall(r"^\| [^|]+ \| .*?\]\((\w+\.md)\)", text, re.M)


@pytest.mark.parametrize("page", pages_of_the_index())
def test_page_of_the_index_begins_with_three_commands_and_is_followed(page):
    text = (PROJECT / "docs" / page).read_text(encoding="utf-8")
    commands = [
        line for block in re.findall(r"^```bash\n(.*?)^```$", text, re.M | re.S) for line in block.splitlines() if "mrp-sumo" in line
    ]
    assert len(commands) >= 3
    assert page in tool("docs").TUTORIALS
