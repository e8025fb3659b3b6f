"""The paper's demonstration: a double pendulum with a clearance joint, against an ideal one.

Draws figures 13 to 17 of P. Flores, J. Ambrosio, J. C. P. Claro and H. M. Lankarani, "Dynamics of
multibody systems with spherical and spatial revolute clearance joints" (section 6), animates the
journal, and sets the paper's statements beside what came out:

    python -m studies.double_pendulum
    python -m studies.double_pendulum --quick
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import diffrax
import numpy as np
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint import plot

SOLVERS = {
    "bosh3": diffrax.Bosh3,
    "tsit5": diffrax.Tsit5,
    "dopri5": diffrax.Dopri5,
    "dopri8": diffrax.Dopri8,
}
SHOULDER, ELBOW, ARM, END_ARM = "shoulder", "elbow", "arm 2", "arm 3"
UPWARDS = {"X": (1.0, 0.0, 0.0), "−Y (upwards)": (0.0, -1.0, 0.0)}
SAVED = 4001
"""Instants at which every run is saved: one number, so that all runs share a compiled program."""
