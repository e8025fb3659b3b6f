"""Joints with clearance: journals in bearings, balls in sockets, pins in slots, sliders, and
backlash."""
