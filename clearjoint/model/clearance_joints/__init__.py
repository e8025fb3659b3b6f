"""Joints with clearance: journals in bearings, balls, slots, guides and backlash."""
