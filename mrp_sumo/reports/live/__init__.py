"""Runs as they go, in a browser."""
