"""Parameters of a scene: paths, scales, and scenes and states as functions of parameters."""
