"""Plug-ins: one registry for planners, assigners, dispatchers, policies, metrics and map readers."""
