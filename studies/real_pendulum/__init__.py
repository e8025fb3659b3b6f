"""Measured swinging pendulum."""
