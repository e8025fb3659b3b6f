"""Find starting points of fits by comparing many runs, without derivatives, with measurements."""
