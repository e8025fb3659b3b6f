"""Numbers of a scene, selected by paths: list, replace, scale and vary numbers, and make the scene
and initial state from parameters. This package runs no simulation."""
