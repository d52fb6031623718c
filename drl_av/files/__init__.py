"""Functions that write files atomically, and that read and write CSV tables."""
