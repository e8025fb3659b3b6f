"""Joints with clearance: bearings, ball sockets, pins in slots, sliders in guides, and backlash."""
