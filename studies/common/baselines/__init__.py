"""The same models in SciPy and Exudyn, for comparison."""
