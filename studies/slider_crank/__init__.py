"""A driven slider-crank whose slider pin has clearance."""
