"""The largest clearance that keeps tolerances, by gradient."""
