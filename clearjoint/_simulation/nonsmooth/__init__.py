"""Simulation with rigid contacts, whose impacts have no duration, by Moreau and Jean's method."""
