"""Pendulum with friction at its hinge, and its motion with sensitivities.

A free swing determines ratios only. The scene therefore has a weight whose largest moment is 1 N m:
friction is relative to it, and inertia is given by the length of the equivalent mathematical
pendulum.
"""

from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import clearjoint as cj
from clearjoint.extend import Scalar, quantity, require_positive

GRAVITY = 9.81
ARM, HINGE, FRICTION = "arm", "hinge", "friction"
DISTANCE = 0.01
"""Distance of the centre of mass from the hinge, m."""
MASS = 1.0 / (GRAVITY * DISTANCE)
"""Mass, kg, for which the largest moment of the weight is 1 N m."""
RTOL, MAX_STEPS = 1e-8, 200_000


class HingeFriction(cj.extend.AbstractDriveTorque):
    """Viscous friction, Coulomb friction (smoothed below a speed) and quadratic friction.

    **Arguments:** as `PrescribedRotation`; `viscous` N m s/rad, `coulomb` N m, `quadratic` N m
    s^2/rad^2, `regularisation_speed` rad/s.
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    axis: Any = quantity("1")
    viscous: Any = quantity("N m s/rad", default=0.0)
    coulomb: Any = quantity("N m", default=0.0)
    quadratic: Any = quantity("N m s^2/rad^2", default=0.0)
    regularisation_speed: Any = quantity("rad/s", default=0.02)
    orientation: Any = quantity("1", default=(1.0, 0.0, 0.0, 0.0))

    def __check_init__(self):
        require_positive("regularisation_speed", self.regularisation_speed, "give it in rad/s")

    def torque_at(self, angle: Scalar, speed: Scalar, t: Scalar) -> Scalar:
        """Return the torque against the speed."""
        del angle, t
        dry = self.coulomb * jnp.tanh(speed / self.regularisation_speed)
        return -(self.viscous * speed + dry + self.quadratic * speed * jnp.abs(speed))


@dataclass(frozen=True)
class Pendulum:
    """Parameters of a swing.

    - `length`: of the equivalent mathematical pendulum, m.
    - `viscous` s/rad, `coulomb` 1, `quadratic` s^2/rad^2: moments of friction over the weight's.
    - `vertical`: measured angle at rest, rad.
    - `angle` rad, `speed` rad/s: at the start.
    """

    length: float
    viscous: float
    coulomb: float
    quadratic: float
    vertical: float
    angle: float
    speed: float

    def scene(self) -> cj.Scene:
        """Return the scene: arm, hinge and friction."""
        inertia = MASS * DISTANCE * (self.length - DISTANCE)
        axis = (0.0, 0.0, 1.0)
        return cj.Scene(
            bodies={ARM: cj.Body(MASS, (inertia,) * 3)},
            joints={
                HINGE: cj.RevoluteJoint(
                    cj.GROUND, ARM, (0.0, 0.0, 0.0), (0.0, DISTANCE, 0.0), axis, axis
                )
            },
            forces={
                FRICTION: HingeFriction(
                    cj.GROUND, ARM, axis, self.viscous, self.coulomb, self.quadratic
                )
            },
            gravity=np.asarray(_gravity(self.vertical)),
        )

    def state(self) -> cj.State:
        """Return the initial state."""
        return _state(np, self.angle, self.speed)


def _gravity(vertical: Any) -> Any:
    return GRAVITY * jnp.stack([jnp.sin(vertical), -jnp.cos(vertical), 0.0 * vertical])


def _state(numpy: Any, angle: Any, speed: Any) -> cj.State:
    sine, cosine, zero = numpy.sin(angle), numpy.cos(angle), 0.0 * angle
    half = 0.5 * angle
    rows = (
        (DISTANCE * sine, -DISTANCE * cosine, zero),
        (numpy.cos(half), zero, zero, numpy.sin(half)),
        (DISTANCE * speed * cosine, DISTANCE * speed * sine, zero),
        (zero, zero, speed + zero),
    )
    return cj.State({ARM: cj.BodyState(*(numpy.stack(row) for row in rows))})


def _with_vertical(scene: cj.Scene, state: cj.State, value: Any) -> tuple[cj.Scene, cj.State]:
    return eqx.tree_at(lambda s: s.gravity, scene, _gravity(value)), state


def _with_angle(scene: cj.Scene, state: cj.State, value: Any) -> tuple[cj.Scene, cj.State]:
    return scene, _state(jnp, value, state.bodies[ARM].spin[2])


def _with_speed(scene: cj.Scene, state: cj.State, value: Any) -> tuple[cj.Scene, cj.State]:
    _, _, _, last = turned = state.bodies[ARM].orientation
    return scene, _state(jnp, 2.0 * jnp.arctan2(last, turned[0]), value)


def _moments(scene: cj.Scene) -> list[Any]:
    return [scene.bodies[ARM].inertia[k] for k in range(3)]


SMALL = cj.Linear(1e-3)
"""Scale of small fractions of one."""


def parameters(pendulum: Pendulum) -> dict[str, cj.Parameter]:
    """Return all parameters, by the names of `Pendulum`."""
    return {
        "length": cj.Parameter(_moments, cj.Log()),
        "viscous": cj.Parameter(lambda scene: scene.forces[FRICTION].viscous, SMALL),
        "coulomb": cj.Parameter(lambda scene: scene.forces[FRICTION].coulomb, SMALL),
        "quadratic": cj.Parameter(lambda scene: scene.forces[FRICTION].quadratic, SMALL),
        "vertical": cj.Parameter.change(_with_vertical, pendulum.vertical, SMALL, "rad"),
        "angle": cj.Parameter.change(_with_angle, pendulum.angle, cj.Linear(), "rad"),
        "speed": cj.Parameter.change(_with_speed, pendulum.speed, cj.Linear(), "rad/s"),
    }


def predicted(pendulum: Pendulum, times: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return angles (N,) at times, rad, and their derivatives (N,) by each field of the pendulum.

    All fields are always included, so that one program serves all fits.
    """
    known = parameters(pendulum)
    found = cj.sensitivities(
        pendulum.scene(),
        pendulum.state(),
        float(times[-1]),
        known,
        {"angle": cj.quantities.JointAngle(HINGE)},
        times,
        start_time=float(times[0]),
        settings=replace(cj.presets.derivatives, rtol=RTOL, max_steps=MAX_STEPS),
    )
    slopes = {"length": 1.0 / (pendulum.length - DISTANCE), "angle": 1.0, "speed": 1.0}
    columns = zip(found.parameters, found.derivatives["angle"].T, strict=True)
    scaled = {name: column * slopes.get(name, 1.0 / SMALL.unit) for name, column in columns}
    return found.outputs["angle"], scaled
