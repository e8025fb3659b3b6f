"""Cost of runs, sweeps, derivatives and first calls, compared with other programs."""
