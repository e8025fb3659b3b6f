"""Joint coordinates of trees, with the mass matrix by the composite rigid body algorithm."""
