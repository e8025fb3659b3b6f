"""Joint coordinates of trees of bodies; the composite rigid body algorithm gives the mass
matrix."""
