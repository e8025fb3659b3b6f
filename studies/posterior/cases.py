"""Scenes with measurements free of noise, and the boxes of their priors."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

import clearjoint as cj
from studies.fits import coverage

SPREAD = {"clearance": 1.0, "play": 1.0, "restitution": 2.0, "stiffness": 1.0, "young": 2.0}
"""Half the width of each prior in coordinates: a factor e in a clearance or a stiffness."""
AXIS = (0.0, 0.0, 1.0)


class Case(coverage.Case):
    """A scene with its measurements free of noise; the box of the prior is centred on the guess."""

    @property
    def spread(self) -> dict[str, float]:
        """Half the width of the box, in coordinates, by name."""
        return {name: SPREAD[name] for name in self.parameters}


def from_fits(case: coverage.Case) -> Case:
    """Return a case of the study of fits, with its far start as guess."""
    return Case(**{**vars(case), "label": f"{case.label}, {1e3 * case.clean.times()[-1]:g} ms"})


def readings(
    scene: cj.Scene,
    state: cj.State,
    parameters: dict[str, cj.Parameter],
    channels: dict[str, tuple[cj.extend.Quantity, float]],
    times: np.ndarray,
) -> cj.Measurements:
    """Return readings without noise of channels with their noise, at times (N,), s."""
    tight = replace(cj.presets.derivatives, rtol=1e-11)
    quantities = {name: channel for name, (channel, _) in channels.items()}
    found = cj.sensitivities(
        scene, state, times[-1], parameters, quantities, times, settings=tight
    ).outputs
    return cj.Measurements(
        {name: cj.Series(c, times, found[name], noise) for name, (c, noise) in channels.items()}
    )


def slider_crank() -> Case:
    """Return the slider-crank with clearance at the slider pin, probes of 5 µm, 10 ms at 10 kHz."""
    pin = "slider pin"
    truth = {"clearance": 0.5e-3, "restitution": 0.9}
    scene, state = cj.mechanisms.slider_crank(truth["clearance"], truth["restitution"])
    parameters = {
        "clearance": cj.Parameter(lambda s: s.joints[pin].clearance, cj.Log()),
        "restitution": cj.Parameter(lambda s: s.joints[pin].law.restitution, cj.Bounded(0, 1)),
    }
    channels = {
        "x": (cj.quantities.JournalOffset(pin, "x"), 5e-6),
        "y": (cj.quantities.JournalOffset(pin, "y"), 5e-6),
    }
    clean = readings(scene, state, parameters, channels, np.arange(1, 101) * 1e-4)
    guess = {"clearance": 0.8e-3, "restitution": 0.7}
    return Case("slider-crank, 10 ms", scene, state, parameters, truth, guess, (), clean)


def backlash() -> Case:
    """Return a motor and a link with backlash, the motor's encoder of 0.2 mrad, 50 ms at 2 kHz."""
    truth = {"play": 0.01, "restitution": 0.7, "stiffness": 3e7}
    law = cj.laws.ExactRestitution(truth["restitution"], truth["stiffness"])
    origin = (0.0, 0.0, 0.0)
    bodies = {
        "motor": cj.Body(1.0, (1e-3, 1e-3, 1e-3)),
        "link": cj.Body(2.0, (4e-3, 4e-3, 4e-3)),
    }
    joints = {
        "shaft": cj.RevoluteJoint("ground", "motor", origin, origin, AXIS, AXIS),
        "hinge": cj.RevoluteJoint("motor", "link", origin, origin, AXIS, AXIS),
        "gearbox": cj.Backlash("motor", "link", play=truth["play"], radius=0.01, law=law),
    }
    scene = cj.Scene(bodies, joints)
    spinning = cj.body_state(origin, spin=(0.0, 0.0, 2.0))
    state = cj.State({"motor": spinning, "link": cj.body_state(origin)})
    parameters = {
        "play": cj.Parameter(lambda s: s.joints["gearbox"].play, cj.Log()),
        "restitution": cj.Parameter(
            lambda s: s.joints["gearbox"].law.restitution, cj.Bounded(0, 1)
        ),
        "stiffness": cj.Parameter(lambda s: s.joints["gearbox"].law.stiffness.stiffness, cj.Log()),
    }
    channels: dict = {
        "motor": (cj.quantities.JointAngle("shaft"), 2e-4),
        "play": (cj.quantities.JointAngle("hinge"), 2e-4),
    }
    clean = readings(scene, state, parameters, channels, np.arange(1, 101) * 5e-4)
    guess = {"play": 0.016, "restitution": 0.5, "stiffness": 6e7}
    return Case("backlash, 50 ms", scene, state, parameters, truth, guess, (), clean)


CASES: dict[str, Callable[[], Case]] = {
    "crank-rocker, short": lambda: from_fits(coverage.pins("rocker foot", 1.1, 0.02)),
    "crank-rocker": lambda: from_fits(coverage.pins("rocker foot", 1.1)),
    "slider-crank": slider_crank,
    "backlash": backlash,
    "camera": lambda: from_fits(coverage.pendulums("camera", "soft, narrow")),
}
