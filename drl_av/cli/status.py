"""Exit statuses other than 0 (success), 1 (error) and 2 (bad usage)."""

INTERRUPTED = 130
"""Interrupted by Ctrl-C, as shells report it."""
