"""Cost of accuracy: solvers, tolerances, landing, laws and precision."""
