"""Functions that return mechanisms from the literature, each with its initial state."""
