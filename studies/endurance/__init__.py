"""A day of a motion, or a hundred million steps, in one call."""
