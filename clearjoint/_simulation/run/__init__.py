"""Complete runs from their start to their end: checks, the loop of steps, recorders that collect
data in this loop, and results."""
