"""Programs to compare with: the same models in SciPy and in Exudyn."""
