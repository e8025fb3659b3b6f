"""Parameters of a scene: paths that select its numbers, the scales on which a fit changes these,
and scenes and initial states as functions of parameters. This package runs no simulation."""
