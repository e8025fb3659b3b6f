"""Results of a run: its solution, its table of impacts, and observations computed from a
solution."""
