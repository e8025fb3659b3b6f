"""The primitives of JAX that do not work element by element, and their rules."""

from . import control, indexing, reductions, structure

RULES = structure.RULES | indexing.RULES | reductions.RULES | control.RULES
"""Rules by the names of primitives, for `clearjoint.native.lowering.Lowering`."""
