"""The experiments of ``drl-av reproduce``: their tables, figures and summaries."""
