"""Complete runs from their start to their end: the loop of steps, recorders, checks, and
results."""
