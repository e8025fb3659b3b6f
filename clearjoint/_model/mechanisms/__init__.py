"""Functions that return example mechanisms, many from the literature, with their initial states."""
