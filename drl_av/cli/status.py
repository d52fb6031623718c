"""Exit statuses other than 0 (success), 1 (error) and 2 (bad usage)."""

INTERRUPTED = 130
"""The status after Ctrl-C, as shells report it."""
