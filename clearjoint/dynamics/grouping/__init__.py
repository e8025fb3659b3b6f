"""Groups of bodies and clearance joints that differ only in numbers and are computed as arrays, and
coordinates of scenes with such groups."""
