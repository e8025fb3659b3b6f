"""Clearance joints: flights, rebounds and impacts against closed forms."""

import math
from dataclasses import replace
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from scipy.special import beta

import clearjoint as cj
from clearjoint.plot import style
from studies.catalogue import gear_rattle
from studies.catalogue.check import Check

TIGHT = cj.Settings(rtol=1e-10, atol=1e-12)
GRAVITY = 9.81
HERE, Z_AXIS = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
INERTIAS, PLAY, RADIUS, SPEED = (1e-3, 4e-3), 2e-3, 0.05, 2.0
"""Two shafts: moments of inertia, kg m^2, backlash, rad, radius, m, and speed, rad/s."""
FIRST_TOUCH = 0.002692503
"""First touch of Siconos' slider-crank, whose slider has clearance in its guide, s."""
FIGURE = "[clearance joints](plays.png)"


def checks(quick: bool) -> list[Check]:
    """Check each clearance joint; quick is only the gears' rattle, at one speed."""
    rattle = gear_rattle.check(quick)
    if quick:
        return [rattle]
    plays = _backlash(), _gears(), rattle, _ball(), _pin(), _slider()
    return [*plays, _clearance(), _lobes(), _line()]


def impacts(scene: cj.Scene, state: cj.State, end: float) -> cj.results.Impacts:
    """Return the impacts of a run."""
    run = cj.simulate(scene, state, end, TIGHT, cj.Saving(impacts=True), progress=False)
    assert run.impacts is not None
    return run.impacts


def off(found: Any, expected: Any) -> float:
    """Return the largest relative difference."""
    return float(np.abs(np.asarray(found) / np.asarray(expected) - 1.0).max())


def shafts(restitution: float) -> tuple[cj.Scene, cj.State]:
    """Return two shafts on one axis with backlash between them, the first turning."""
    bodies = {
        name: cj.Body(1.0, (5e-3, 5e-3, inertia))
        for name, inertia in zip("ab", INERTIAS, strict=True)
    }
    joints: dict[str, Any] = {
        name: cj.RevoluteJoint("ground", name, HERE, HERE, Z_AXIS, Z_AXIS) for name in "ab"
    }
    law = cj.laws.ExactRestitution(restitution=restitution, stiffness=1e8, exponent=1.0)
    joints["play"] = cj.Backlash("b", "a", play=PLAY, radius=RADIUS, law=law)
    states = {"a": cj.body_state(HERE, spin=(0.0, 0.0, SPEED)), "b": cj.body_state(HERE)}
    return cj.Scene(bodies, joints), cj.State(states)


def _backlash() -> Check:
    hits = impacts(*shafts(0.6), 0.02)
    entries = RADIUS * SPEED * 0.6 ** np.arange(len(hits))
    flights = hits.onset[1:] - hits.separation[:-1]
    largest = max(off(hits.entry_speed, entries), off(flights, RADIUS * PLAY / entries[1:]))
    against = "speeds and flights of two shafts: closed forms"
    return Check("Backlash", "Nordin, Gutman 2002", against, largest, 1e-6, FIGURE)


def _gears() -> Check:
    hits = impacts(*cj.mechanisms.gear_pair(backlash=1e-4, restitution=0.8), 0.02)
    base_radius = 20 * 0.5 * 3e-3 * math.cos(math.radians(20.0))
    entries = 10.0 * base_radius * 0.8 ** np.arange(len(hits))
    flights = hits.onset[1:] - hits.separation[:-1]
    expected = 1e-4 * math.cos(math.radians(20.0)) / entries[1:]
    largest = max(off(hits.entry_speed, entries), off(flights, expected))
    against = "speeds and flights of two gears with backlash: closed forms"
    return Check("GearBacklash, gear_pair", "involute gears", against, largest, 1e-6, FIGURE)


def _ball() -> Check:
    clearance, restitution = 0.2e-3, 0.7
    law = cj.laws.ExactRestitution(restitution, 1e16)
    joint = cj.BallInSocket("ground", "b", socket_radius=10e-3, clearance=clearance, law=law)
    body = cj.Body(2.0, (1e-3, 1e-3, 1e-3))
    scene = cj.Scene({"b": body}, {"joint": joint}, gravity=(0.0, -GRAVITY, 0.0))
    hits = impacts(scene, cj.State({"b": cj.body_state(HERE)}), 0.02)
    again = hits.separation[0] + 2.0 * hits.exit_speed[0] / GRAVITY
    largest = max(
        off(hits.onset[:2], (math.sqrt(2.0 * clearance / GRAVITY), again)),
        off(hits.entry_speed[0], math.sqrt(2.0 * GRAVITY * clearance)),
    )
    against = "fall into the socket, and the bounce after it: closed forms"
    return Check("BallInSocket", "a sphere in a sphere", against, largest, 1e-7, FIGURE)


def _pin() -> Check:
    speed, mass, stiffness, play = 0.4, 0.5, 1e9, 1e-3
    joint = cj.PinInSlot("ground", "b", play=play, pin_radius=5e-3, law=cj.laws.Hertz(stiffness))
    scene = cj.Scene({"b": cj.Body(mass, (1e-4, 1e-4, 1e-4))}, {"joint": joint})
    state = cj.State({"b": cj.body_state(HERE, velocity=(0.3, speed, 0.0))})
    hits = impacts(scene, state, 0.012)
    deepest = (1.25 * mass * speed**2 / stiffness) ** 0.4
    lasts = 2.0 * deepest / speed * beta(0.4, 0.5) / 2.5
    largest = max(
        off(np.diff(hits.onset), play / speed + lasts), off(hits.largest_penetration, deepest)
    )
    against = "flights between the walls, and Hertz's contacts with them: closed forms"
    return Check("PinInSlot", "a circle between lines", against, largest, 1e-5, FIGURE)


def _slider() -> Check:
    scene, state = cj.mechanisms.guided_slider_crank()
    hits = impacts(scene, state, 4e-3)
    against = "first touch in Siconos' example, s: converged independent solution"
    source = "Flores, Leine, Glocker 2010"
    largest = off(hits.onset[0], FIRST_TOUCH)
    return Check("SliderInGuide, guided_slider_crank", source, against, largest, 1e-5, FIGURE)


def _clearance() -> Check:
    clearance = 0.5e-3
    hits = impacts(*cj.mechanisms.double_pendulum(clearance), 0.012)
    largest = off(hits.onset[0], math.sqrt(2.0 * clearance / GRAVITY))
    against = "fall of the journal to the wall: closed form"
    return Check("ClearanceJoint", "the paper", against, largest, 1e-7, FIGURE)


def two_lobes() -> tuple[cj.Scene, cj.State, float]:
    """Return a rotor that swings on the wall of a bearing with two lobes, its state, and the
    radius, m, of the circle on which its centre moves.

    The centre of a circular journal on the wall moves on a curve with the support function
    clearance + deviation. At the lowest point, the radius of curvature of the curve is this plus
    the second derivative of the deviation: clearance - height + 4 height.
    """
    clearance, height, mass, stiffness, angle = 50e-6, 8e-6, 20.0, 1e9, 0.01
    scene, _ = cj.mechanisms.rotor_in_bearing(
        clearance, mass=mass, law=cj.laws.Hertz(stiffness, exponent=1.0)
    )
    lobes = cj.profiles.Harmonics([0.0, height])
    pin = replace(scene.joints["bearing"], bearing_profile=lobes)
    scene = replace(scene, joints={**scene.joints, "bearing": pin})
    # Both ends of the journal carry half of the weight.
    depth = 0.5 * mass * GRAVITY / stiffness
    radius = clearance + 3.0 * height + depth
    lowest = -(clearance - height + depth)
    place = (radius * math.sin(angle), lowest + radius * (1.0 - math.cos(angle)), 0.0)
    state = cj.State({"rotor": cj.body_state(place, spin=(0.0, 0.0, 200.0))})
    return scene, state, radius


def _lobes() -> Check:
    scene, state, radius = two_lobes()
    pace = math.sqrt(GRAVITY / radius)
    times = np.linspace(0.0, 4.0 * math.pi / pace, 81)
    run = cj.simulate(scene, state, times[-1], TIGHT, cj.Saving(times), progress=False)
    x = np.asarray(run.states.bodies["rotor"].position)[:, 0]
    largest = float(np.abs(x / x[0] - np.cos(pace * times)).max())
    against = "swing of a rotor on the wall of an oval bearing: pendulum of the curvature's radius"
    entry, source = "ClearanceJoint(bearing_profile=)", "support functions"
    return Check(entry, source, against, largest, 1e-3, FIGURE)


def _line() -> Check:
    """Check the rocking of a journal that gravity presses on the wall along its whole length."""
    mass, inertia, stiffness, length, clearance = 1.0, 2e-4, 1e8, 40e-3, 1e-3
    joint = cj.ClearanceJoint(
        "ground",
        "b",
        bearing_radius=10e-3,
        clearance=clearance,
        journal_length=length,
        law=cj.laws.Hertz(stiffness, exponent=1.0),
        axial=cj.FixedAxially(),
        line_points=3,
    )
    scene = cj.Scene(
        {"b": cj.Body(mass, (inertia, inertia, inertia))},
        {"joint": joint},
        gravity=(0, -GRAVITY, 0),
    )
    depth, rate = mass * GRAVITY / stiffness, math.sqrt(stiffness * length**2 / (12.0 * inertia))
    # Both ends stay in the wall.
    spin = 0.5 * rate * depth / (0.5 * length)
    state = cj.body_state((0.0, -clearance - depth, 0.0), spin=(spin, 0.0, 0.0))
    times = np.linspace(0.0, 10.0 * math.pi / rate, 201)
    run = cj.simulate(
        scene, cj.State({"b": state}), times[-1], TIGHT, cj.Saving(times), progress=False
    )
    angles = 2.0 * np.asarray(run.states.bodies["b"].orientation)[:, 1]
    largest = float(np.abs(angles - spin / rate * np.sin(rate * times)).max() / (spin / rate))
    against = "rocking of a journal on the wall, with the stiffness K L^2/12: closed form"
    source = "Winkler foundation"
    return Check("ClearanceJoint(line_points=3)", source, against, largest, 1e-7, FIGURE)


def figure() -> Figure:
    """Draw the relative angle and the remaining energy of two shafts with backlash, and the
    amplitude of gear rattle."""
    drawn, (left, right, last) = plt.subplots(1, 3, figsize=(13.0, 4.2), layout="constrained")
    times = np.linspace(0.0, 0.012, 1500)
    for restitution, colour in ((1.0, style.BLUE), (0.6, style.VERMILLION)):
        scene, state = shafts(restitution)
        run = cj.simulate(scene, state, times[-1], TIGHT, cj.Saving(times), progress=False)
        bodies = run.states.bodies
        angles = {name: 2.0 * np.arcsin(bodies[name].orientation[:, 3]) for name in "ab"}
        spins = np.stack([np.asarray(bodies[name].spin)[:, 2] for name in "ab"])
        energies = 0.5 * (np.array(INERTIAS)[:, None] * spins**2).sum(axis=0)
        label = f"restitution {restitution:g}"
        left.plot(1e3 * times, 1e3 * (angles["a"] - angles["b"]), color=colour, label=label)
        right.plot(1e3 * times, 1e3 * energies, color=colour, label=label)
    for edge in (-0.5e3 * PLAY, 0.5e3 * PLAY):
        label = "flanks" if edge > 0.0 else None
        left.axhline(edge, color="0.5", linestyle="--", label=label)
    style.dress(left, "time, ms", "angle between the shafts, mrad")
    style.dress(right, "time, ms", "kinetic energy, mJ")
    right.set_ylim(bottom=0.0)
    handles = left.get_legend_handles_labels()
    drawn.legend(*handles, loc="outside lower left", ncols=3, frameon=False)
    gear_rattle.draw(last)
    last.legend(frameon=False)
    return drawn
