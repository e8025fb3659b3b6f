"""Modes of motion of a journal in its bearing."""

import enum


class MotionMode(enum.IntEnum):
    """The four modes of a journal in its bearing, by which of its two bases touch the wall.

    - `FREE_FLIGHT`: none of the bases touches.
    - `ONE_BASE`: one base touches.
    - `LINE_CONTACT`: both touch, on the same side of the bearing.
    - `OPPOSITE_SIDES`: both touch, on opposite sides: the journal is tilted.

    >>> cj.results.MotionMode(2).name
    'LINE_CONTACT'
    """

    FREE_FLIGHT = 0
    ONE_BASE = 1
    LINE_CONTACT = 2
    OPPOSITE_SIDES = 3
