"""Modes of motion of a journal in its bearing."""

import enum


class MotionMode(enum.IntEnum):
    """The paper's four modes of a journal in its bearing (Fig. 2).

    >>> cj.results.MotionMode(2).name
    'LINE_CONTACT'
    """

    FREE_FLIGHT = 0
    ONE_BASE = 1
    LINE_CONTACT = 2
    OPPOSITE_SIDES = 3
