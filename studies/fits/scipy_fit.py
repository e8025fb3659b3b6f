"""Parameters of the double pendulum by SciPy's `least_squares` without derivatives.

The method is the trust region reflective one with `x_scale="jac"`, over unbounded coordinates.
Derivatives are forward differences, so that a Jacobian takes a run for each parameter; the default
step is 1.5e-8 of the coordinate.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import clearjoint as cj

RTOL = 1e-9
MAX_STEPS = 30_000
"""Limit for runs with absurd parameters; a normal run takes about 800 steps."""
BASES = np.array([[-0.5, 0.0, -10e-3], [-0.5, 0.0, 10e-3]])
"""Bases V and W in the frame of arm 2, m."""
UNREACHED = 1e6
"""Residual of each sample of a failed run, in standard deviations."""
MAX_EVALUATIONS = 100
"""Limit of evaluations in each window; SciPy's default is 100 for each parameter."""


@dataclass(frozen=True)
class Found:
    """Coordinates (p,) at the end of a search, the number of runs, and the time taken, s."""

    coordinates: np.ndarray
    runs: int
    seconds: float


def probes(values: Sequence[float], times: np.ndarray) -> np.ndarray:
    """Return x and y of the bases V and W, (4, T) m, for the three parameters."""
    scene, state = cj.mechanisms.double_pendulum()
    scene = eqx.tree_at(
        lambda s: (
            s.joints["shoulder"].law.stiffness.young_modulus,
            s.joints["shoulder"].law.restitution,
            s.joints["shoulder"].clearance,
        ),
        scene,
        tuple(np.asarray(value) for value in values),
    )
    run = cj.simulate(
        scene,
        state,
        times[-1],
        cj.Settings(rtol=RTOL, landing_tolerance=1e-13, max_steps=MAX_STEPS),
        save=cj.Saving(times),
        progress=False,
    )
    arm = run.states.bodies["arm 2"]
    rotation = Rotation.from_quat(np.asarray(arm.orientation), scalar_first=True)
    rows = [np.asarray(arm.position) + rotation.apply(base) for base in BASES]
    return np.concatenate([row[:, :2].T for row in rows])


def fit(
    times: np.ndarray,
    measured: np.ndarray,
    noise: float,
    scales: Sequence[cj.extend.AbstractScale],
    start: np.ndarray,
    ends: Sequence[float],
    difference: float | None,
) -> Found:
    """Fit the samples (4, T) up to each end of a window, s, one after the other.

    **Arguments:** `start`: coordinates (p,); `difference`: SciPy's relative `diff_step`.
    """
    runs = 0

    def residuals(coordinates: np.ndarray, end: float) -> np.ndarray:
        nonlocal runs
        runs += 1
        inside = times <= end
        values = [float(s.value(u)) for s, u in zip(scales, coordinates, strict=True)]
        try:
            predicted = probes(values, times[inside])
        except (cj.SimulationError, ValueError):
            return np.full(measured[:, inside].size, UNREACHED)
        return ((predicted - measured[:, inside]) / noise).ravel()

    begun, at = time.perf_counter(), start
    for end in ends:
        at = least_squares(
            residuals,
            at,
            args=(end,),
            x_scale="jac",
            diff_step=difference,
            max_nfev=MAX_EVALUATIONS,
        ).x
    return Found(at, runs, time.perf_counter() - begun)
