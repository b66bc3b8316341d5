"""Scenario files: everything one run needs, as YAML."""
