"""Search for a way round the safety checks, beside the package and not in its wheel."""
