"""Benchmark and co-simulation of AGV fleets: maps, planners, SUMO execution, metrics, rosbags."""

__version__ = "0.1.0"

# name -> module: `import mrp_sumo` loads nothing heavy
LAZY = {"load_results": "mrp_sumo.io.results", "load_run": "mrp_sumo.io.run_reader"}


def __getattr__(name: str) -> object:
    """The names of LAZY, loaded when first asked for."""
    if name not in LAZY:
        raise AttributeError(f"module 'mrp_sumo' has no attribute '{name}'")
    from importlib import import_module

    return getattr(import_module(LAZY[name]), name)
