"""An accelerometer with limited bandwidth: a seismic mass on a spring and a damper."""

import math
from dataclasses import replace
from typing import ClassVar, NamedTuple

import equinox as eqx
import numpy as np
from typing_extensions import override

from .._dynamics.constraint_report import check_names
from .._fields.cautions import quiet
from .._fields.checks import (
    as_number,
    nearest,
    require,
    require_axis,
    require_point,
    require_positive,
)
from .._fields.types import TripleLike
from .._math.rotations import unit
from .._math.vectors import Scalar
from .._model.bodies import Body, BodyState, State, body_state
from .._model.forces import SpringDamper
from .._model.joints.ideal import PrismaticJoint
from .._model.scene import Scene
from .base import AbstractQuantity, Instant, require_known

ARM = 1e-2
"""Free length of the spring, m: much longer than the deflections of micrometres."""
SHARE = 1e-6
"""Default ratio of the sensor's mass to the body's, which hardly affects the motion."""
RADIUS = 1e-3
"""Radius of gyration of the seismic mass, m, which can't rotate relative to its body."""
BUTTERWORTH = math.sqrt(0.5)
"""Damping ratio of a second-order Butterworth filter, with the flattest possible response."""
SPRING = " spring"
"""Suffix of the name of a sensor's spring."""


class AccelerometerReading(AbstractQuantity):
    """Signal of a `clearjoint.accelerometer` in the scene, m/s^2: the spring's force on the seismic
    mass along the sensor's axis, without the damper's force, divided by this mass. `sensor` is the
    name of the seismic mass and of its joint.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> sensor = cj.accelerometer(scene, state, "arm 2", axis=(0, 1, 0), frequency=2e3)
    >>> reading = cj.quantities.AccelerometerReading("arm 2 accelerometer")
    >>> reading == sensor.reading
    True
    """

    sensor: str = eqx.field(static=True)
    unit: ClassVar[str | None] = "m/s^2"

    @override
    def check(self, scene: Scene) -> None:
        springs = {name.removesuffix(SPRING) for name in scene.forces if name.endswith(SPRING)}
        require_known("sensor", self.sensor, springs & set(scene.bodies) & set(scene.joints))

    @override
    def __call__(self, now: Instant) -> Scalar:
        scene, motions = now.scene, now.motions
        spring, slide = scene.forces[self.sensor + SPRING], scene.joints[self.sensor]
        assert isinstance(spring, SpringDamper) and isinstance(slide, PrismaticJoint)
        body, sensor = motions[slide.first], motions[slide.second]
        # The deflection of the mass from where the spring is unloaded, m in axes of the body. The
        # spring's force on the mass is opposite to this deflection.
        apart = body.components(sensor.position - body.point(slide.point_first))
        return -spring.stiffness / scene.bodies[self.sensor].mass * apart.dot(unit(slide.axis))


class Accelerometer(NamedTuple):
    """Scene and state with a sensor, and the quantity `reading`: the sensor's signal in m/s^2.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> sensor = cj.accelerometer(scene, state, "arm 2", axis=(0, 1, 0), frequency=2e3)
    >>> list(sensor.scene.bodies)
    ['arm 2', 'arm 3', 'arm 2 accelerometer']
    """

    scene: Scene
    state: State
    reading: AccelerometerReading


def accelerometer(
    scene: Scene,
    state: State,
    body: str,
    *,
    point: TripleLike = (0.0, 0.0, 0.0),
    axis: TripleLike,
    frequency: float,
    damping_ratio: float = BUTTERWORTH,
    mass: float | None = None,
    name: str | None = None,
) -> Accelerometer:
    """Attach an accelerometer to a body: a mass that slides along an axis on a spring and a damper.

    The sensor measures the specific force along its axis, acceleration minus gravity, with a
    second-order low-pass 1 / (1 + 2 z s/w + s^2/w^2), where s is the variable of the Laplace
    transform, w = 2 pi `frequency`, and z is the damping ratio. The default z = sqrt(1/2) is a
    Butterworth filter. Impacts of microseconds thus become signals as long as the filter's
    response, which can be sampled and fitted.

    The sensor is part of the mechanism: derivatives of its signal by parameters are exact, and its
    frequency and damping can be estimated, as ``stiffness`` and ``damping`` of its spring. The mass
    starts at rest on the body, deflected by gravity. Steps become as short as a fraction of 1/w.

    ```python
    import clearjoint as cj

    scene, state = cj.mechanisms.double_pendulum()
    scene, state, reading = cj.accelerometer(
        scene, state, "arm 2", point=(0.25, 0.0, 0.0), axis=(0.0, 1.0, 0.0), frequency=2e3
    )
    solution = cj.simulate(scene, state, 0.01)
    outputs = {"shock": cj.Peak(reading, "m/s^2")}  # or a Series, or a Sensor's channel
    ```

    **Arguments:**

    - `point`: position of the sensor, (3,) m in body axes; by default the centre of mass.
    - `axis`: direction of measurement, (3,) in body axes, any length.
    - `frequency`: natural frequency of the mass on its spring without damping, Hz. With the default
      damping ratio, the attenuation at this frequency is 3 dB.
    - `damping_ratio`: z, positive.
    - `mass`: of the sensor, kg; by default a millionth of the body's mass, which hardly affects the
      motion.
    - `name`: of the seismic mass and of its joint; by default the body's name followed by "
      accelerometer". The spring's name is this name followed by " spring".

    **Raises:** `ValueError` if a value is outside its range, the scene or the state lacks the body,
    or the sensor's or its spring's name is in use.

    **Source:** C. Harris and A. Piersol, *Harris' shock and vibration handbook* (2002), chapter 12.
    """
    check_names(scene, state)
    name = f"{body} accelerometer" if name is None else name
    require(isinstance(name, str) and name != "", "name", name, "a text", "give a name, or None")
    remedy = nearest(body, scene.bodies, "pass one of these")
    require(body in scene.bodies, "body", body, f"one of {sorted(scene.bodies)}", remedy)
    require(body in state.bodies, "state", sorted(state.bodies), f"one with {body!r}", "add it")
    is_free = not {name, name + SPRING} & {*scene.bodies, *scene.joints, *scene.forces}
    require(is_free, "name", name, "one that the scene does not have", "give another name")
    require_point("point", position := np.asarray(as_number(point, "point", "m")))
    require_axis("axis", along := np.asarray(as_number(axis, "axis")))
    direction = along / np.linalg.norm(along)
    require_positive("frequency", as_number(frequency, "frequency", "Hz"), "give it in Hz")
    require_positive("damping_ratio", as_number(damping_ratio, "damping_ratio"), "0.7 is usual")
    mass = SHARE * float(scene.bodies[body].mass) if mass is None else mass
    require_positive("mass", as_number(mass, "mass", "kg"), "give it in kg")
    # The spring's free length is long compared with its deflection, so that it acts linearly along
    # the axis although it is a spring between two points: one on the body, and the mass. It is
    # unloaded with the mass at `point`.
    omega = 2.0 * math.pi * frequency
    stiffness, damping = mass * omega**2, 2.0 * damping_ratio * mass * omega
    ends = position - ARM * direction, np.zeros(3)
    spring = SpringDamper(body, name, *ends, stiffness, damping, free_length=ARM)
    slide = PrismaticJoint(body, name, position, np.zeros(3), direction)
    # Making the new scene checks all elements again: don't repeat the warnings of the given scene.
    with quiet():
        bodies = {**scene.bodies, name: Body(mass, np.full(3, mass * RADIUS**2))}
        joints, forces = {**scene.joints, name: slide}, {**scene.forces, name + SPRING: spring}
        with_sensor = replace(scene, bodies=bodies, joints=joints, forces=forces)
    at_rest = _state_at_rest(state.bodies[body], scene, position, direction, omega)
    start = replace(state, bodies={**state.bodies, name: at_rest})
    return Accelerometer(with_sensor, start, AccelerometerReading(name))


def _state_at_rest(
    body: BodyState, scene: Scene, position: np.ndarray, direction: np.ndarray, omega: float
) -> BodyState:
    """Return the state of the seismic mass, at rest relative to `body`, deflected by gravity from
    `position`, m, along the unit vector `direction`, both in axes of the body; `omega` is the
    natural angular frequency of the mass, rad/s."""
    # The rotation q v q* of a vector v by the body's Euler parameters q, as two cross products.
    scalar, *vector = np.asarray(body.orientation, dtype=float)
    axis = np.array(vector)

    def in_global_axes(local: np.ndarray) -> np.ndarray:
        across = 2.0 * np.cross(axis, local)
        return local + scalar * across + np.cross(axis, across)

    gravity = np.zeros(3) if scene.gravity is None else np.asarray(scene.gravity)
    # At rest the spring carries the weight: its deflection is the gravity along the axis over w^2.
    arm = position + direction * float(gravity @ in_global_axes(direction)) / omega**2
    spin = np.asarray(body.spin)
    place = np.asarray(body.position) + in_global_axes(arm)
    velocity = np.asarray(body.velocity) + in_global_axes(np.cross(spin, arm))
    return body_state(place, np.asarray(body.orientation), velocity, spin)
