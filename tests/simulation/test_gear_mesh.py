"""Gears whose stiffness and transmission error vary over the mesh cycle, against Lagrange's
equations integrated by SciPy."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import clearjoint as cj
from tests.support.one_body import ORIGIN, Z, hinge
from tests.support.slow import slow_but

FINE = cj.Settings(rtol=1e-11, atol=1e-13, ledger=True)
END, MODULE, ALPHA = 6e-3, 3e-3, math.radians(20.0)
TIMES = np.linspace(0.0, END, 61)
NAMES = "pinion", "wheel"
SENSES = 1.0, -1.0
"""Of the upper and the lower flank."""


class Pair:
    """Two gears drawn at random, which rattle under torques, and Lagrange's equations of them.

    With fixed centres the relative displacement is s = r1 (theta1 - phase) + r2 theta2, the mesh
    angle z1 (theta1 - phase), and the stored energy k U of the depths +-(s - e) - j cos(alpha)/2.
    """

    def __init__(self, seed: int):
        draw = np.random.default_rng(seed)
        self.teeth = int(draw.integers(17, 30)), int(draw.choice([1, -1]) * draw.integers(45, 70))
        self.backlash, self.stiffness = draw.uniform(0.5e-4, 2e-4), draw.uniform(2e8, 6e8)
        self.radii = [0.5 * MODULE * z * math.cos(ALPHA) for z in self.teeth]
        self.phase = draw.uniform(-0.5, 0.5)
        law = cj.laws.MemorylessHuntCrossley(0.8, self.stiffness, design_speed=1.0, exponent=1.0)
        self.damping = 1.5 * (1.0 - 0.8) / 1.0
        waves = draw.normal(scale=2e-6, size=(2, 3))
        self.error = cj.profiles.Harmonics(*waves)
        self.factor, self.varying = self._stiffness(draw)
        self.torques = draw.uniform(10.0, 40.0) * np.array([1.0, self.radii[1] / self.radii[0]])
        angle = draw.uniform(-3.0, 3.0)
        ahead = 0.3 * self.backlash * draw.uniform(-1.0, 1.0)
        starts = self._error(self.teeth[0] * (angle - self.phase))[0] + ahead
        other = (starts - self.radii[0] * (angle - self.phase)) / self.radii[1]
        speed = draw.uniform(30.0, 90.0)
        spins = speed, -speed * self.teeth[0] / self.teeth[1] + draw.uniform(-0.5, 0.5)
        self.start = np.array([angle, other, *spins])
        self.inertias = draw.uniform(2e-4, 8e-4), draw.uniform(2e-3, 9e-3)
        apart = 0.5 * MODULE * abs(sum(self.teeth))
        sense = draw.choice([1.0, -1.0])
        mesh = cj.GearBacklash(
            *NAMES,
            *(ORIGIN, ORIGIN, Z, (0.0, 0.0, sense)),
            *self.teeth,
            *(MODULE, self.backlash, law),
            phase=self.phase,
            stiffness=self.varying,
            transmission_error=self.error,
        )
        joints, forces, bodies, states = {"mesh": mesh}, {}, {}, {}
        for k, name in enumerate(NAMES):
            centre, turn = (k * apart, 0.0, 0.0), 0.5 * self.start[k]
            bodies[name] = cj.Body(1.0, (0.6 * self.inertias[k],) * 2 + (self.inertias[k],))
            joints[f"{name} bearing"] = hinge("ground", name, centre)
            forces[name] = cj.DriveTorque("ground", name, Z, self.torques[k])
            states[name] = cj.body_state(
                centre, (math.cos(turn), 0, 0, math.sin(turn)), spin=(0, 0, self.start[2 + k])
            )
        self.scene = cj.Scene(bodies, joints, forces, gravity=(0.0, 0.0, 0.0))
        self.state = cj.State(states)

    def _stiffness(self, draw: np.random.Generator) -> tuple[Callable, Any]:
        """A factor over the mesh cycle with its slope, independently of the class, and the class's
        object."""
        if draw.uniform() < 0.5:
            a, b = draw.uniform(-0.2, 0.2, 2)
            return (
                lambda x: 1 + a * math.cos(x) + b * math.sin(2 * x),
                cj.profiles.StiffnessHarmonics([a, 0.0], [0.0, b]),
            )
        share, part, middle = draw.uniform(0.3, 0.7), draw.uniform(0.1, 0.25), draw.uniform(-3, 3)
        width = 2 * math.pi * part / (2 * math.atanh(0.8))

        def factor(x: float) -> float:
            x -= middle
            a, b = (2 / width * math.sin(0.5 * (math.pi * share + y)) for y in (x, -x))
            return (1.0 + 0.5 * (1.0 + math.tanh(a) * math.tanh(b))) / (1.0 + share)

        return factor, cj.profiles.TeethInMesh(1.0 + share, part, middle)

    def _error(self, x: float) -> tuple[float, float]:
        value = slope = 0.0
        for k, (a, b) in enumerate(zip(self.error.cosines, self.error.sines, strict=True), 1):
            c, s = math.cos(k * x), math.sin(k * x)
            value, slope = value + a * c + b * s, slope + k * (b * c - a * s)
        return float(value), float(slope)

    def depth(self, y: np.ndarray, sense: float) -> float:
        """Depth of the upper flank (1) or the lower one (-1)."""
        first = y[0] - self.phase
        moved = self.radii[0] * first + self.radii[1] * y[1] - self._error(self.teeth[0] * first)[0]
        return sense * moved - 0.5 * self.backlash * math.cos(ALPHA)

    def flank(self, y: np.ndarray, sense: float) -> tuple[float, float]:
        """Normal force of a flank, and its stored energy over the factor."""
        x, rate = self.teeth[0] * (y[0] - self.phase), self.teeth[0] * y[2]
        moving = self.radii[0] * y[2] + self.radii[1] * y[3] - self._error(x)[1] * rate
        depth = max(self.depth(y, sense), 0.0)
        spring = self.stiffness * depth
        damped = max(1.0 + self.damping * sense * moving, 0.0)
        return self.factor(x) * spring * damped, 0.5 * spring * depth

    def rates(self, t: float, y: np.ndarray) -> list[float]:
        """Lagrange's equations."""
        first, second = self.torques
        x, step = self.teeth[0] * (y[0] - self.phase), 1e-5
        slope = (self.factor(x + step) - self.factor(x - step)) / (2.0 * step)
        for sense in SENSES:
            force, energy = self.flank(y, sense)
            of_cycle = sense * force * self._error(x)[1] - slope * energy
            first -= sense * force * self.radii[0] - self.teeth[0] * of_cycle
            second -= sense * force * self.radii[1]
        return [y[2], y[3], first / self.inertias[0], second / self.inertias[1]]

    def integrated(self) -> list[Any]:
        """The motion piece by piece, from one change of a contact to the next."""
        t, y, pieces = 0.0, self.start, []
        closed = {sense: self.depth(y, sense) > 0.0 for sense in SENSES}
        while t < END:

            def changes(t: float, y: np.ndarray, sense: float) -> float:
                return self.depth(y, sense)

            events = [partial(changes, sense=sense) for sense in closed]
            for event, touches in zip(events, closed.values(), strict=True):
                event.terminal, event.direction = True, -1.0 if touches else 1.0
            run = solve_ivp(
                *(self.rates, (t, END), y),
                method="DOP853",
                rtol=1e-12,
                atol=1e-15,
                max_step=4e-6,
                # A flight may be shorter than the largest step.
                first_step=min(1e-8, END - t),
                dense_output=True,
                events=events,
            )
            pieces.append(run.sol)
            fired = zip(closed.items(), run.t_events, strict=True)
            closed = {sense: touches != (len(times) > 0) for (sense, touches), times in fired}
            t, y = run.t[-1], run.y[:, -1]
        return pieces


def at(pieces: list[Any], times: np.ndarray) -> np.ndarray:
    """The states at times, (N, 4)."""
    ends = [motion.t_max for motion in pieces]
    return np.array([pieces[min(np.searchsorted(ends, t), len(ends) - 1)](t) for t in times])


@pytest.mark.parametrize("seed", slow_but([0], range(20)))
def test_gears_move_as_lagranges_equations_say(seed):
    """Speeds, the energy ledger, and the largest force of the impacts."""
    pair = Pair(seed)
    save = cj.Saving(TIMES, impacts=True)
    run = cj.simulate(pair.scene, pair.state, END, FINE, save, progress=False)
    motion = pair.integrated()
    expected = at(motion, TIMES)
    for k, name in enumerate(NAMES):
        spins = run.states.bodies[name].spin @ pair.scene.forces[name].axis
        speeds = expected[:, 2 + k]
        np.testing.assert_allclose(spins, speeds, rtol=0.0, atol=1e-6 * np.abs(speeds).max())
    energies, work = cj.observe(pair.scene, run).energies, run.states.work
    energy = energies["mechanical"] - work["supplied"] + work["normal damping"]
    assert np.ptp(energy) < 1e-8 * np.abs(work["supplied"]).max()
    hits = run.impacts
    assert hits is not None and len(hits) > 0
    forces = [
        pair.flank(piece(t), sense)[0]
        for piece in motion
        for t in np.linspace(piece.t_min, piece.t_max, 300)
        for sense in SENSES
        if piece.t_max <= hits.separation.max() + 1e-9
    ]
    assert hits.peak_force.max() == pytest.approx(max(forces), rel=1e-4)
