"""Draw fits of robots to their logs."""

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from .._fields.checks import require
from .style import BLUE, GREY, dress, legend_above, panels

Loop = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Position and torque of a joint at N times, (N,) each, as logged and then as predicted."""


class FittedRobot(Protocol):
    """What the figure needs of `clearjoint.results.RobotFit`, which this module must not import."""

    def hysteresis(self) -> Mapping[str, Loop]:
        """Return logged and predicted positions and torques, by name of the driven joint."""
        ...


def joint_hysteresis(fit: FittedRobot) -> np.ndarray:
    """Draw the torque of each driven joint over the joint's position, as logged and as predicted by
    a `fit` from `cj.fit_robot`.

    **Returns:** array (number of joints,) of the axes in a new figure.

    **Raises:** `ValueError` if the log has torque and position of no driven joint.

    >>> from types import SimpleNamespace
    >>> angle = np.linspace(0.0, 1.0, 20)
    >>> loop = cj.results.Hysteresis(angle, angle**2, angle, 1.1 * angle**2)
    >>> result = SimpleNamespace(hysteresis=lambda: {"elbow": loop})  # or of cj.fit_robot
    >>> axes = plot.joint_hysteresis(result)
    """
    loops = fit.hysteresis()
    remedy = "log both of them"
    require(bool(loops), "fit", [*loops], "with torque and position of a driven joint", remedy)
    _, (axes,) = panels(len(loops), (4.6, 3.6))
    for (joint, loop), drawn in zip(loops.items(), axes, strict=True):
        position, torque, *predicted = loop
        drawn.plot(position, torque, ".", color=GREY, markersize=3, label="logged")
        drawn.plot(*predicted, color=BLUE, linewidth=0.8, label="predicted")
        dress(drawn, f"position of {joint}, rad or m", "torque, N m or N")
        legend_above(drawn, 2)
    return axes
