"""A swinging pendulum, measured by others."""
