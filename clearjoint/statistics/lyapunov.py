"""Largest Lyapunov exponent of a motion: the growth rate of its tangents, which are derivatives by
the initial velocities."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ..information import error_growth as growth
from ..model.bodies import State
from ..model.scene import Scene
from ..simulation.run.sensitivities import sensitivities
from ..simulation.step import presets
from ..sweeps.axes import Axis
from .starts import disturbed_axes, with_values

SETTINGS = replace(presets.derivatives, derivative_tolerance=1e9)
"""Settings of the runs. With so large a tolerance the tangent does not control the length of steps.
A growth rate needs few correct digits of the tangent, and control by an ever larger tangent would
make steps ever shorter, until runs reach their step limit."""
TIMES = 256
"""Number of times, evenly spaced over the run, at which the size of the tangent is computed."""


def exponents_from(
    scene: Scene,
    state: State,
    end_time: float,
    size: float,
    along: Float[np.ndarray, "members v"],
    start_time: float,
    progress: bool,
) -> tuple[float, float]:
    """Return the largest Lyapunov exponent, 1/s, and its standard error over several starts.

    Each start takes one run with a tangent: the derivative of the motion by a perturbation of the
    initial velocity. Its size is a root mean square displacement of points of the bodies. The
    exponent of a start is the slope of the logarithm of this size over the second half of the run;
    in the first half the tangent turns to the direction of fastest growth. Runs that fail before
    the end are left out. If fewer than two remain, both numbers are NaN.

    **Arguments:**

    - `start_time`, `end_time`: s.
    - `size`, m/s, and `along`: disturbances of the starts, as in `disturbed_velocities`.
    - `progress`: whether to show a bar for each run.
    """
    axes: dict[str, Axis] = disturbed_axes(scene, state, {}, size, along, start_time)
    times = np.linspace(start_time, end_time, TIMES + 1)[1:]
    points = growth.points(scene)
    rates = []
    for k in range(len(along)):
        # The initial state of this member, with its disturbed velocities.
        start = with_values(scene, state, axes, {name: a.values[k] for name, a in axes.items()})[1]
        found = sensitivities(
            scene,
            start,
            end_time,
            {growth.DISTURBANCE: growth.disturbance(scene)},
            points,
            times,
            SETTINGS,
            start_time=start_time,
            throw=False,
            progress=progress,
        )
        # The result of a failed run contains only the times before its failure.
        if len(found.times) == len(times):
            sizes = growth.sizes(found.derivatives, points)[:, 0]
            rates.append(growth.rate(times, sizes, 0.5 * (start_time + end_time)))
    if len(rates) < 2:
        return float("nan"), float("nan")
    return float(np.mean(rates)), float(np.std(rates, ddof=1) / np.sqrt(len(rates)))
