"""Motions of bodies."""

from clearjoint.extend import IDENTITY, ZERO, Motion

AT_REST = Motion(ZERO, IDENTITY, ZERO, ZERO)
