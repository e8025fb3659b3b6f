"""Joint coordinates of open chains of bodies; the composite rigid body algorithm gives the mass
matrix."""
