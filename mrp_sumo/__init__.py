"""Benchmark and co-simulation of AGV fleets: maps, planners, SUMO execution, metrics, rosbags."""

__version__ = "0.1.0"
