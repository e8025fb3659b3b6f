"""Groups of alike elements of a scene, which are computed as arrays, and coordinates for such
scenes."""
