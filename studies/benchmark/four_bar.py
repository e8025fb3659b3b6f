"""A planar four-bar with play and friction at both ends of its coupler."""

import clearjoint as cj

PLAY = {"crank pin": 0.2e-3, "rocker pin": 0.2e-3}
"""Radial clearance, m."""


def four_bar() -> tuple[cj.Scene, cj.State]:
    """`clearjoint.four_bar` with play of 0.2 mm at both ends of the coupler, restitution 0.8 and
    friction, at rest."""
    return cj.four_bar(PLAY, 0.8, friction=cj.RegularisedCoulomb(0.1))
