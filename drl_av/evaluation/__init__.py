"""Evaluates drivers: comparison, statistics, recording and replay."""

DENSITIES = (1, 5, 10, 15, 20, 25, 30)
"""The numbers of vehicles around the ego in the published tables (docs/results)."""
