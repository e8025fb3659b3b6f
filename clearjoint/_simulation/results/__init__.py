"""Results of a run: its solution, its table of impacts, and observations of a solution."""
