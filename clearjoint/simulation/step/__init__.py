"""One step of a run: a trial step, its acceptance, its adjustment to end at events, and
derivatives."""
