"""Exit statuses beside 0, 1 (failure) and 2 (usage)."""

INTERRUPTED = 130
"""Interrupted by Ctrl-C, as shells report it."""
