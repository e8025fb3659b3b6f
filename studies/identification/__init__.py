"""Parameters from made-up measurements: which searches find them."""
