"""Complete runs: checks, the loop of steps, recorders that collect data in this loop, and
results."""
