"""Cost of a step by feature and by coordinates, and drift in long runs."""
