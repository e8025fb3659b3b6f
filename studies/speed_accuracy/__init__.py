"""What accuracy costs: solvers, tolerances, landing, laws and precision."""
