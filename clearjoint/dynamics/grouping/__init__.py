"""Groups of elements with the same structure in a scene, and coordinates for grouped scenes."""
