"""Parameter estimation from simulated measurements: searches, statistics and horizon."""
