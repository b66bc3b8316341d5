"""Capacity studies, which choose their own runs, and their answers."""
