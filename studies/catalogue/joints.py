"""Ideal joints, drives and elements against closed forms, all in one run."""

import math
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

import clearjoint as cj
from clearjoint.plot import style
from studies.catalogue import machines as of
from studies.catalogue.check import Check
from studies.catalogue.overlay import Compared, legend, overlay

SETTINGS = cj.Settings(rtol=1e-10, atol=1e-10, stabilisation=cj.Projection())
END = 10.0
TIMES = np.append(np.linspace(0.0, 3.0, 601), [9.99, END])
"""Saved times, s."""
PENDULUM = ((-0.316436469914, -0.948613704576), (-0.275087462577, -0.961419205099))
"""Positions of the IFToMM benchmark A01 at the last two times, m."""
FIGURE = "[joints](joints.png)"


def run() -> dict[str, cj.BodyState]:
    """Return the motion of all machines."""
    scene, state = of.machines()
    save = cj.Saving(TIMES)
    return cj.simulate(scene, state, END, SETTINGS, save, progress=False).states.bodies


def checks(quick: bool) -> list[Check]:
    """Check each joint, drive and element; none is quick."""
    if quick:
        return []
    bodies = run()
    return [
        _row(
            "UniversalJoint, PrescribedAngle", "Hooke", "speed of the second shaft", *cardan(bodies)
        ),
        _row("ScrewJoint", "a nut on a spindle", "descent under its weight", *nut(bodies)),
        _row("GearJoint", "teeth", "speeds under a torque", *gears(bodies)),
        _row("PlanarJoint", "a plate on a slope", "its path", *plate(bodies)),
        _row("PrescribedTranslation, PrismaticJoint", "a pusher", "the cart", *cart(bodies)),
        _row("DistanceJoint", "IFToMM A01", "pendulum near 10 s: benchmark", *rod(bodies)),
        _row("Bushing", "an elastic liner", "position of a body in it", *cushioned(bodies)),
        _row("TorsionalSpring", "a damped oscillator", "angle", *sprung(bodies)),
        _row("Motor", "PD, clipped", "speed: SciPy's DOP853", *driven(bodies)),
    ]


def _row(entry: str, source: str, what: str, found: np.ndarray, expected: np.ndarray) -> Check:
    off = float(np.abs(found - expected).max() / np.abs(expected).max())
    against = what if ":" in what else f"{what}: closed form"
    return Check(entry, source, f"{against}, of the largest", off, 1e-7, FIGURE)


def cardan(bodies: dict[str, cj.BodyState]) -> tuple[np.ndarray, np.ndarray]:
    """Return the speed of the shaft behind a universal joint, and Hooke's formula."""
    angle = of.DRIVE[0] + TIMES * (of.DRIVE[1] + TIMES * of.DRIVE[2])
    speed = of.DRIVE[1] + 2.0 * of.DRIVE[2] * TIMES
    return np.asarray(bodies["tilted"].spin)[:, 2], speed * of.hooke(angle, of.TILT)[1]


def nut(bodies: dict[str, cj.BodyState]) -> tuple[np.ndarray, np.ndarray]:
    """Return the height of a nut on its spindle, and its closed form."""
    heavier = 1.0 + of.NUT_INERTIA * (2.0 * math.pi / of.LEAD) ** 2 / of.NUT
    return np.asarray(bodies["nut"].position)[:, 1], -0.5 * of.GRAVITY / heavier * TIMES**2


def gears(bodies: dict[str, cj.BodyState]) -> tuple[np.ndarray, np.ndarray]:
    """Return the speeds of two gears under a torque on the first, and their closed form."""
    acceleration = of.TORQUE / (of.PINION + of.WHEEL / 9.0)
    spins = [np.asarray(bodies[name].spin)[:, 2] for name in ("pinion", "wheel")]
    return np.stack(spins), acceleration * np.stack([TIMES, -TIMES / 3.0])


def plate(bodies: dict[str, cj.BodyState]) -> tuple[np.ndarray, np.ndarray]:
    """Return the path of a plate on a slope in the slope's axes, and its closed form."""
    down = of.SLOPE.inv().apply((0.0, -of.GRAVITY, 0.0)) * (1.0, 1.0, 0.0)
    path = np.outer(TIMES, (1.0, 2.0, 0.0)) + 0.5 * np.outer(TIMES**2, down)
    return of.SLOPE.inv().apply(np.asarray(bodies["plate"].position)), path


def cart(bodies: dict[str, cj.BodyState]) -> tuple[np.ndarray, np.ndarray]:
    """Return the position of a cart that a driver moves to and fro, and its closed form."""
    return np.asarray(bodies["cart"].position)[:, 0], of.STROKE * np.cos(of.PACE * TIMES)


def rod(bodies: dict[str, cj.BodyState]) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of a ball on a rod, and the benchmark's."""
    return np.asarray(bodies["ball"].position)[-2:, :2], np.array(PENDULUM)


def cushioned(bodies: dict[str, cj.BodyState]) -> tuple[np.ndarray, np.ndarray]:
    """Return the position of a body on an elastic liner, and its closed form."""
    swing = away(0.5 * of.SOFTENING / of.CUSHIONED, of.SOFTNESS / of.CUSHIONED)
    return np.asarray(bodies["cushioned"].position)[:, 0], of.SHIFT * swing


def away(decay: float, square: float) -> np.ndarray:
    """Return a damped oscillation from rest at one; `square` is the squared undamped frequency."""
    pace = math.sqrt(square - decay**2)
    swing = np.cos(pace * TIMES) + decay / pace * np.sin(pace * TIMES)
    return np.exp(-decay * TIMES) * swing


def sprung(bodies: dict[str, cj.BodyState]) -> tuple[np.ndarray, np.ndarray]:
    """Return the angle of a rotor on a torsional spring, and its closed form."""
    swing = away(0.5 * of.DAMPING / of.ROTOR, of.STIFFNESS / of.ROTOR)
    turned = np.asarray(bodies["sprung"].orientation)
    return 2.0 * np.arctan2(turned[:, 3], turned[:, 0]), of.REST + of.RELEASED * swing


def driven(bodies: dict[str, cj.BodyState]) -> tuple[np.ndarray, np.ndarray]:
    """Return the speed of a rotor that a motor turns to its target, and SciPy's."""
    width = 0.02 * of.LIMIT

    def clipped(wanted: float) -> float:
        over = abs(wanted) - of.LIMIT
        bend = 0.0 if over < -width else over if over > width else (over + width) ** 2 / 4 / width
        return math.copysign(abs(wanted) - bend, wanted)

    def rates(t: float, y: np.ndarray) -> tuple[float, float]:
        del t
        return y[1], clipped(of.GAIN * (of.TARGET - y[0]) - of.DAMPER * y[1]) / of.ROTOR

    options: Any = {"rtol": 1e-12, "atol": 1e-13, "max_step": 0.02}
    path = solve_ivp(rates, (0.0, END), (0.0, 0.0), "DOP853", TIMES, **options)
    return np.asarray(bodies["driven"].spin)[:, 2], path.y[1]


def figure() -> Figure:
    """Draw four of the motions and their closed forms."""
    bodies = run()
    drawn, panels = plt.subplots(2, 2, figsize=(10.0, 6.0), layout="constrained", sharex=True)
    shown = {
        "shaft behind a cardan joint, rad/s": cardan,
        "nut on its spindle, m": nut,
        "rotor on a torsional spring, rad": sprung,
        "rotor on a clipped motor, rad/s": driven,
    }
    for axes, (label, motion) in zip(panels.flat, shown.items(), strict=True):
        found, expected = motion(bodies)
        overlay(axes, Compared.along(TIMES[:-2], found[:-2], expected[:-2]), every=20)
        style.dress(axes, "time, s" if axes in panels[1] else "", label)
    legend(drawn, panels[0, 0])
    return drawn
