"""Rigid contact with impacts in time steps far above the time of a contact."""
