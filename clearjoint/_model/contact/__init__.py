"""Contact of two surfaces: geometry, laws of the normal force, stiffnesses and friction laws."""
