"""Parameters of a scene: paths that select numbers of the scene, the scales on which a fit changes
these numbers, and scenes and initial states as functions of parameters. This package runs no
simulation."""
