"""Print the JSON schema of scenario files, for editors that complete and check YAML."""

import argparse

from mrp_sumo.cli.printing import say_json


def arguments(parser: argparse.ArgumentParser) -> None:
    """No arguments."""


def run(options: argparse.Namespace) -> int:
    """Print the schema."""
    from mrp_sumo.io.scenario.model import ScenarioModel

    schema = ScenarioModel.model_json_schema()
    say_json({"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}, indent=2)
    return 0
