"""Largest clearance that keeps tolerances."""
