"""Joints with clearance: journals in bearings, balls in sockets, pins in slots, sliders in guides,
and backlash."""
