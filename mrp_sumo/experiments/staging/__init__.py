"""From a scenario to a set-up: everything that a run needs before it is planned."""
