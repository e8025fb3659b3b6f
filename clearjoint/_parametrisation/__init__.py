"""Parameters of a scene: paths that select numbers, the scales on which a fit changes them, and
scenes and initial states as functions of parameters."""
