"""What the documents say is so: commands and options exist, links lead somewhere, pictures of the house match its tests."""

import argparse
import re
import shlex
import tomllib
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import pytest
import yaml
from test_architecture import FLOORS, tool

from mrp_sumo.cli.main import COMMANDS
from mrp_sumo.core.driving import Planning
from mrp_sumo.core.execution import Outcome
from mrp_sumo.core.options import option
from mrp_sumo.core.plan import Status
from mrp_sumo.experiments.run import DISPATCHER_FAILED, POLICY_FAILED
from mrp_sumo.io.documents import declared_in, keys_of
from mrp_sumo.io.scenario.execution import ExecutionChoice
from mrp_sumo.io.scenario.model import ScenarioModel
from mrp_sumo.metrics.operations.audit import RULES
from mrp_sumo.plugins.kinds import KINDS

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


@pytest.mark.parametrize("kind", ["planners", "assigners", "dispatchers", "policies"])
def test_every_parameter_of_plug_ins_has_a_meaning(kind):
    entries = tool("doc_tables")._plug_ins(kind, [])
    assert [one["name"] for one in entries if set(one["parameters"]) != set(one.get("meanings", ()))] == []


def test_parameters_of_step_wise_planners_are_explained():
    explained = set(re.findall(r"`(\w+)(?:`|: )", (PROJECT / "docs" / "step_wise.md").read_text(encoding="utf-8")))
    assert {key for one in tool("doc_tables")._plug_ins("step_planners", []) for key in one["parameters"]} <= explained


def first_column(page, head):
    """Words in backticks of the first column of the table whose head begins so."""
    text = (PROJECT / "docs" / page).read_text(encoding="utf-8")
    rows = re.search(rf"^\| {re.escape(head)} \|.*?\n\n", text + "\n", re.M | re.S)[0]
    return {word for cell in re.findall(r"^\| (.+?) \|", rows.partition("\n")[2], re.M) for word in re.findall(r"`([^`]+)`", cell)}


def literals(folder, pattern):
    """Groups of a pattern in the sources of a folder."""
    texts = (path.read_text(encoding="utf-8") for path in sorted((PROJECT / "mrp_sumo" / folder).rglob("*.py")))
    return {word for text in texts for word in re.findall(pattern, text)}


def test_statuses_of_runs_are_listed():
    no_plan = {f"planning_{one}" for one in Status} - {"planning_solved", "planning_planner_failed"}
    assert first_column("scenario.md", "`status`") == {
        *Outcome,
        *no_plan,
        "planner_failed",
        POLICY_FAILED,
        DISPATCHER_FAILED,
        "audit_failed",
        "refused",
    }


def test_findings_of_the_operations_audit_are_of_its_rules():
    assert set(RULES) == literals("metrics/operations", r"\b(?:Finding|of_order|of_stop)\(\s*\"([^\"]+)\"")


def test_counts_of_the_audit_of_bodies_are_listed():
    assert literals(
        "metrics", r"\"(num_\w+_(?:violations|contacts|crossings|touches|outside|disagreements|collisions|jumps))\""
    ) <= first_column("metrics.md", "key")


def test_files_of_run_folders_are_listed():
    assert literals("io", r"\"(\w+\.(?:parquet|jsonl))\"") - {"results.parquet"} <= first_column("logs.md", "file")


def test_commands_that_listen_are_listed():
    text = (PROJECT / "SECURITY.md").read_text(encoding="utf-8").partition("## What listens")[2]
    listening = {name for name in COMMANDS if "--port" in options_of(parser_of(name))}
    assert listening == {"replay", "run", "status", "studio"}
    assert all(f"`{name}" in text for name in listening)


def test_kinds_of_plug_ins_and_extras_are_listed():
    kinds = re.search(r"^Kinds are (.+?)\.", (PROJECT / "docs" / "own_plugins.md").read_text(encoding="utf-8"), re.M)[1]
    assert set(re.findall(r"`(\w+)`", kinds)) == set(KINDS)
    extras = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    named = re.search(r"^Extras.*?\n\n", (PROJECT / "README.md").read_text(encoding="utf-8"), re.M | re.S)[0]
    assert {name for name in re.findall(r"`(\w+)`", named) if name != "Dockerfile"} == set(extras) - {"docs", "test"}


def test_keys_that_pages_name_exist():
    tables = tool("doc_tables")
    sections = list(keys_of(ScenarioModel))
    keys = {re.sub(r"\[\]", "", key) for section in ("", *sections) for key, _ in tables.keys_in(section)}
    known = {".".join(key.split(".")[: depth + 1]) for key in keys for depth in range(key.count(".") + 1)}
    wrong = set()
    for path in DOCUMENTS:
        for key in re.findall(rf"`(?:--set )?((?:{'|'.join(sections)})\.[a-z_0-9.]+)", path.read_text(encoding="utf-8")):
            if key not in known and not key.startswith(FREE) and not key.endswith((".md", ".parquet", ".yaml", ".png")):
                wrong.add(f"{path.name}: {key}")
    assert not wrong


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


FREE = ("planner.parameters.", "planner.chosen", "planner.why", "execution.policy.parameters.", "tasks.service_factor.", "tasks.stations.")
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
