"""Contact of two surfaces: the gap, stiffness, normal laws, friction, delivered restitution."""
