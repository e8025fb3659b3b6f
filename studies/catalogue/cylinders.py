"""Line contact: the force of each law inserted into its printed formula."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from scipy.optimize import brentq

import clearjoint as cj
from clearjoint.extend import AbstractElasticity
from studies.catalogue.check import Check

RADIUS, CLEARANCE, LENGTH = 10e-3, 0.5e-3, 20e-3
YOUNG, POISSON = 207e9, 0.3
MODULUS = YOUNG / (2.0 * (1.0 - POISSON**2))
"""Effective modulus E*, Pa."""
RELATIVE = RADIUS * (RADIUS - CLEARANCE) / CLEARANCE
"""Relative radius of curvature, m."""
DEPTHS = np.array([1e-9, 1e-6, 8e-6, 1e-4])
FIGURE = "[forces](../contact_laws/forces.png)"


def johnson(load: np.ndarray) -> np.ndarray:
    """Return the penetration of a load in N/m, m."""
    return load * (np.log(4.0 * np.pi * MODULUS * CLEARANCE / load) - 1.0) / (np.pi * MODULUS)


def esdu(load: np.ndarray) -> np.ndarray:
    """Return the penetration of a load in N/m, m."""
    return load * (np.log(4.0 * np.pi * MODULUS * CLEARANCE / load) + 1.0) / (np.pi * MODULUS)


def radzimovsky(load: np.ndarray) -> np.ndarray:
    """Return the penetration of a load in N/m, m."""
    width = 1.60 * np.sqrt(load * RELATIVE / MODULUS)
    both = np.log(4.0 * RADIUS / width) + np.log(4.0 * (RADIUS - CLEARANCE) / width)
    return load * (2.0 / 3.0 + both) / (np.pi * MODULUS)


def dubowsky_freudenstein(load: np.ndarray) -> np.ndarray:
    """Return the penetration of a load in N/m, m: Goldsmith's with a unitless exponent."""
    flatness = 1.0 / (np.pi * MODULUS)
    return load * flatness * (np.log(LENGTH**2 / (load * RELATIVE * flatness)) + 1.0)


FORMULAS = {
    cj.laws.JohnsonCylinder: ("Johnson 1985", johnson),
    cj.laws.EsduCylinder: ("ESDU 78035", esdu),
    cj.laws.RadzimovskyCylinder: ("Radzimovsky 1953", radzimovsky),
    cj.laws.GoldsmithCylinder: ("Goldsmith 1960, m = 3", dubowsky_freudenstein),
    cj.laws.DubowskyFreudensteinCylinder: ("Dubowsky, Freudenstein 1971", dubowsky_freudenstein),
}
AT_EIGHT_MICROMETRES = {
    cj.laws.LiuCylinder: ("Liu et al. 2007", 2536.0),
    cj.laws.PereiraCylinder: ("Pereira et al. 2011, 2014", 9612.0),
}
"""Forces of an independent script, N."""


def force(contact: AbstractElasticity, depths: np.ndarray) -> np.ndarray:
    """Return forces (N,), N, at penetrations (N,), m."""
    return np.asarray(
        contact.force(cj.extend.Gap(jnp.asarray(depths), 0.0, RADIUS, CLEARANCE), 1.5)
    )


def checks(quick: bool) -> list[Check]:
    """Check each law of line contact."""
    del quick
    rows: list[Check] = []
    for law, (source, formula) in FORMULAS.items():
        loads = force(law(YOUNG, POISSON, length=LENGTH), DEPTHS) / LENGTH
        off = float(np.abs(formula(loads) / DEPTHS - 1.0).max())
        against = "its force inserted into the printed formula, 1 nm to 0.1 mm"
        rows.append(Check(law.__name__, source, against, off, 1e-12, FIGURE))
    for law, (source, expected) in AT_EIGHT_MICROMETRES.items():
        found = force(law(YOUNG, POISSON, length=LENGTH), np.array([8e-6]))[0]
        against = "force at 8 µm: an independent script"
        rows.append(Check(law.__name__, source, against, abs(found / expected - 1.0), 3e-4, FIGURE))
    return [*rows, _of_persson()]


def _of_persson() -> Check:
    """Check the half-angles of two loads, degrees."""
    contact = cj.laws.PerssonCylinder(YOUNG, POISSON, length=LENGTH)

    def degrees(load: float) -> float:
        angle: Any = brentq(lambda a: float(contact.load(a, CLEARANCE)) - load, 1e-6, 1.4)
        return float(np.degrees(angle))

    off = max(abs(degrees(load) - at) for load, at in ((1466.0, 2.32), (1e5, 18.6)))
    against = "half-angles of 1466 N and 100 kN: an independent script, degrees"
    return Check("PerssonCylinder", "Persson 1964", against, off, 0.05, FIGURE)
