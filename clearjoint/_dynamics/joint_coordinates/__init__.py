"""Joint coordinates of trees of bodies."""
