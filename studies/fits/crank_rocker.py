"""Crank-rocker with clearance in one pin, measured by two probes in the bearing and an encoder."""

import math
from dataclasses import replace

import numpy as np

import clearjoint as cj

LENGTHS = (0.06, 0.18, 0.14, 0.2)
"""Lengths of crank, coupler and rocker, and distance of the feet, m."""
AREA, DENSITY = math.pi * 0.006**2, 7850.0
"""Cross-section and density of round steel rods of 12 mm, m^2 and kg/m^3."""
SPEED = 2.0 * math.pi * 150.0 / 60.0
"""Speed of the crank, rad/s."""
TRUTH = {"clearance": 0.15e-3, "restitution": 0.85, "stiffness": 9e8}
FAR = {"clearance": 0.3e-3, "restitution": 0.6, "stiffness": 18e8}
GROW = (0.006, 0.02, 0.04)
RATE, END = 2000.0, 0.08
PROBE, ENCODER = 5e-6, 1e-4
"""Noise of the sensors, m and rad."""


def scene(pin: str, angle: float) -> tuple[cj.Scene, cj.State]:
    """Return the mechanism with clearance in a pin, from an angle of the crank in rad."""
    crank, coupler, rocker = (AREA * DENSITY * length for length in LENGTHS[:3])
    stiffness = cj.laws.GivenStiffness(TRUTH["stiffness"])
    return cj.mechanisms.four_bar(
        {pin: TRUTH["clearance"]},
        lengths=LENGTHS,
        masses=(crank, coupler, rocker),
        angle=angle,
        speed=SPEED,
        motor=cj.PrescribedRotation(
            "ground", "crank", (0.0, 0.0, 1.0), speed=SPEED, initial_angle=angle
        ),
        law=cj.laws.LankaraniNikravesh(restitution=TRUTH["restitution"], stiffness=stiffness),
    )


def parameters(pin: str) -> dict[str, cj.Parameter]:
    """Return clearance, restitution and stiffness of a pin as parameters."""
    return {
        "clearance": cj.Parameter(lambda s: s.joints[pin].clearance, cj.Log()),
        "restitution": cj.Parameter(lambda s: s.joints[pin].law.restitution, cj.Bounded(0, 1)),
        "stiffness": cj.Parameter(lambda s: s.joints[pin].law.stiffness.stiffness, cj.Log()),
    }


def ideal(pin: str, angle: float, end_time: float = END) -> cj.Measurements:
    """Return the readings of the sensors without noise."""
    times = np.arange(1, round(end_time * RATE) + 1) / RATE
    noise = {"probe x": PROBE, "probe y": PROBE, "encoder": ENCODER}
    channels = {
        "probe x": cj.quantities.JournalOffset(pin, "x"),
        "probe y": cj.quantities.JournalOffset(pin, "y"),
        "encoder": cj.quantities.JointAngle("rocker foot"),
    }
    tight = replace(cj.presets.derivatives, rtol=1e-11)
    found = cj.sensitivities(
        *scene(pin, angle), end_time, parameters(pin), channels, times, settings=tight
    )
    series = {n: cj.Series(c, times, found.outputs[n], noise[n]) for n, c in channels.items()}
    return cj.Measurements(series)
