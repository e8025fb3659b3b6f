"""Results of a run: solutions, the table of impacts, and observations derived from them."""
