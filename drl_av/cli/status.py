"""Exit statuses beyond 0, 1 for a failure and 2 for usage."""

INTERRUPTED = 130
"""By Ctrl-C, as a shell tells it."""
