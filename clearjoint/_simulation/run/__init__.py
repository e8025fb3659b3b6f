"""Complete runs: checks, the loop of steps, recorders that collect data in it, and results."""
