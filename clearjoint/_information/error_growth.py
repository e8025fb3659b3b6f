"""Growth of small differences between motions, measured by displacements of points of the bodies.

A difference is the derivative of the motion by a parameter, such as a perturbation of the initial
velocity. Its size is the root mean square displacement of four points of each body: the centre of
mass, and a point on each body axis at the distance of the radius of gyration.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import equinox as eqx
import numpy as np

from .._dynamics.formulation import Formulation
from .._dynamics.joint_coordinates.coordinates import JointCoordinates
from .._dynamics.system import System
from .._math.vectors import Scalar, fold_constants, pack, unpack
from .._model.bodies import State
from .._model.scene import Scene
from .._parametrisation.parameter import Parameter
from ..quantities.base import Quantity
from ..quantities.bodies import PointPosition
from ..quantities.joints import Penetration

DISTURBANCE = "initial velocity"
"""Name of the parameter that perturbs the initial state."""
DIRECTION = (0.53, 0.62, 0.58)
"""Direction of the perturbing velocity, of about unit length, with a component along every axis."""


@dataclass(frozen=True)
class _Push:
    """Function that adds a perturbation of a given size, m/s, to the initial velocities.

    Every body gets an additional velocity of this size, and an additional spin that moves points at
    its radius of gyration, m, with the same speed. `radii` has pairs of body and radius. Components
    of the perturbation that ideal joints forbid are dropped; joints that close a loop are ignored.
    """

    radii: tuple[tuple[str, float], ...]

    def __call__(self, scene: Scene, state: State, value: Scalar) -> tuple[Scene, State]:
        along = value * np.array(DIRECTION)
        bodies = dict(state.bodies)
        for name, radius in self.radii:
            twist = (bodies[name].velocity + along, bodies[name].spin + along / radius)
            bodies[name] = eqx.tree_at(lambda b: (b.velocity, b.spin), bodies[name], twist)
        # Encoding the velocities in joint coordinates drops the part that the joints forbid.
        system = System(unpack(fold_constants(scene)), Formulation(JointCoordinates()))
        compatible = system.decode(system.encode(unpack(bodies)))
        return scene, eqx.tree_at(lambda s: s.bodies, state, pack(compatible))


def disturbance(scene: Scene) -> Parameter:
    """Return a parameter of the value zero: the size of a perturbation of the initial velocities,
    m/s. Derivatives by this size show how small differences grow. If the perturbation violates
    constraints of drivers or of joints that close a loop, the stabilisation of these constraints
    reduces the perturbation during the run."""
    return Parameter.change(_Push(tuple(radii_of_gyration(scene).items())), 0.0, unit="m/s")


def points(scene: Scene) -> dict[str, Quantity]:
    """Return the global coordinates, m, of four points of each body as quantities by name: the
    centre of mass, and on each axis of the body one at the radius of gyration from it."""
    quantities: dict[str, Quantity] = {}
    for body, radius in radii_of_gyration(scene).items():
        for k, point in enumerate([(0.0, 0.0, 0.0), *np.diag([radius] * 3).tolist()]):
            for component in ("x", "y", "z"):
                name = f"point {k} of {body}: {component}"
                quantities[name] = PointPosition(body, point, component)
    return quantities


def penetrations(scene: Scene) -> dict[str, Quantity]:
    """Return the penetrations of all contacts, m, as quantities by name."""
    contacts = [(joint, contact) for joint, laws in scene.laws().items() for contact in laws]
    return {f"penetration of {j}: {contact}": Penetration(j, contact) for j, contact in contacts}


def sizes(derivatives: Mapping[str, np.ndarray], names: Mapping[str, Quantity]) -> np.ndarray:
    """Return the root mean square displacement of the points, (T, p), per unit of each of p
    parameters, from the derivatives of outputs, (T, p) by name. `names`: the result of `points`,
    whose keys are the names of the outputs to use."""
    # The mean is over coordinates; three of them make a point, hence the factor 3.
    squares = [derivatives[name] ** 2 for name in names]
    return np.sqrt(3.0 * np.mean(squares, axis=0))


def rate(times: np.ndarray, size: np.ndarray, since: float) -> float:
    """Return the rate, 1/s, of exponential growth of displacements `size` from the time `since` on:
    the slope of a line fitted to their logarithms; NaN for fewer than two that are positive."""
    used = (times >= since) & (size > 0.0)
    if used.sum() < 2:
        return math.nan
    return float(np.polyfit(times[used], np.log(size[used]), 1)[0])


def radii_of_gyration(scene: Scene) -> dict[str, float]:
    """Return each body's radius of gyration, m, by name."""
    return {name: body.gyration_radius() for name, body in scene.bodies.items()}
