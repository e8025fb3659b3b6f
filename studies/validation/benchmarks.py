"""Mechanisms of the IFToMM multibody benchmarks, of which `studies.catalogue` has the motions."""

import numpy as np

import clearjoint as cj
from studies.catalogue.joints import PENDULUM, SETTINGS
from studies.catalogue.mechanisms import CORNERS, bricard, double_four_bar, squeezer
from studies.validation.check import Check

ANGLES = {"beta": 0, "gamma": 2, "delta": 4, "epsilon": 6}
"""Rows of the angles of Andrews' mechanism that are not relative to another body."""


def benchmarks(quick: bool) -> list[Check]:
    """Check the benchmarks A01 to A04, or quickly A01 alone."""
    if quick:
        return _pendulum()
    return [*_pendulum(), *_double_four_bar(), *_squeezer(), *_bricard()]


def _pendulum() -> list[Check]:
    """Check the last position of a point mass on a rod of 1 m, released from the horizontal."""
    rod = cj.DistanceJoint("ground", "mass", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0)
    mass = cj.Body(1.0, (1.0, 1.0, 1.0))
    scene = cj.Scene({"mass": mass}, {"rod": rod}, gravity=(0.0, -9.81, 0.0))
    start = cj.State({"mass": cj.body_state((-1.0, 0.0, 0.0))})
    found = cj.simulate(scene, start, 10.0, SETTINGS, progress=False).final.bodies["mass"].position
    return _points("IFToMM A01, reference", "mass", 10.0, PENDULUM[-1], found)


def _double_four_bar() -> list[Check]:
    """Check the tip of the first rod, which has passed the singular positions many times."""
    compared = double_four_bar()
    expected, found = compared.expected[:, -1], compared.found[:, -1]
    return _points("IFToMM A02, closed form", "tip of a rod", 10.0, expected, found)


def _squeezer() -> list[Check]:
    """Check angles after 30 ms, of which whole turns are removed."""
    compared = squeezer()
    return [
        Check(
            "IFToMM A03 (Andrews), IVP test set",
            f"angle {name} at 0.03 s",
            "rad",
            float(compared.expected[row, 0]),
            float(compared.found[row, -1]),
        )
        for name, row in ANGLES.items()
    ]


def _bricard() -> list[Check]:
    """Check a corner of Bricard's mechanism."""
    compared = bricard()
    source = "IFToMM A04 (Bricard), least-squares solver"
    return _points(source, "corner", 2.0, CORNERS[2.0], compared.found[:, -1])


def _points(
    source: str, name: str, time: float, expected: np.ndarray | tuple, found: np.ndarray
) -> list[Check]:
    """Return a check of each component of a position, m, that is expected at a time, s."""
    return [
        Check(source, f"{axis} of the {name} at {time:.3g} s", "m", float(value), float(ours))
        for axis, value, ours in zip("xyz", expected, found, strict=False)
    ]
