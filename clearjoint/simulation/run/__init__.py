"""Single runs, and runs with derivatives: checks, loop, recorders and the functions users call."""
