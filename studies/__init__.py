"""The experiments of ``python -m studies``: their tables, figures and summaries."""
