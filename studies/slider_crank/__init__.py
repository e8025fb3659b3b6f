"""Driven slider-crank with clearance at the slider pin."""
