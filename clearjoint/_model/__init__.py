"""Model of a mechanism: bodies, joints, laws, the scene, and mechanisms from the literature."""
