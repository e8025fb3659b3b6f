"""A band-limited accelerometer: a seismic mass on a spring and a damper."""

import math
from typing import ClassVar, NamedTuple

import equinox as eqx
import numpy as np

from ..fields.cautions import quiet
from ..fields.checks import (
    as_number,
    require,
    require_axis,
    require_point,
    require_positive,
)
from ..fields.suggestions import nearest
from ..fields.types import TripleLike
from ..math.rotations import unit
from ..math.vectors import Scalar
from ..model.bodies import Body, BodyState, State, body_state
from ..model.forces.springs_and_loads import SpringDamper
from ..model.joints.ideal import PrismaticJoint
from ..model.scene import Scene
from .base import AbstractQuantity, require_known
from .instant import Instant

ARM = 1e-2
"""Length of the slack spring, m: far above deflections, which are micrometres."""
SHARE = 1e-6
"""Mass of the sensor in that of its body, unless it is given."""
RADIUS = 1e-3
"""Radius of gyration of the sensor's mass, m."""
BUTTERWORTH = math.sqrt(0.5)
SPRING = " spring"
"""What the name of a sensor's spring has behind the sensor's."""


class AccelerometerReading(AbstractQuantity):
    """What an accelerometer of `clearjoint.accelerometer` reads, m/s^2.

    **Arguments:** `sensor`: its name.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> found = cj.accelerometer(scene, state, "arm 2", axis=(0, 1, 0), frequency=2e3)
    >>> reading = cj.quantities.AccelerometerReading("arm 2 accelerometer")
    >>> reading.unit, reading == found.reading
    ('m/s^2', True)
    """

    sensor: str = eqx.field(static=True)
    unit: ClassVar[str | None] = "m/s^2"

    def check(self, scene: Scene) -> None:
        """Check that the scene has the sensor."""
        springs = {name.removesuffix(SPRING) for name in scene.forces if name.endswith(SPRING)}
        require_known("sensor", self.sensor, springs & set(scene.bodies) & set(scene.joints))

    def __call__(self, now: Instant) -> Scalar:
        """The spring's force on its mass over the mass, m/s^2."""
        scene, motions = now.scene, now.motions
        spring, slide = scene.forces[self.sensor + SPRING], scene.joints[self.sensor]
        assert isinstance(spring, SpringDamper) and isinstance(slide, PrismaticJoint)
        body, sensor = motions[slide.first], motions[slide.second]
        apart = body.components(sensor.position - body.point(slide.point_first))
        return -spring.stiffness / scene.bodies[self.sensor].mass * apart.dot(unit(slide.axis))


class Accelerometer(NamedTuple):
    """A scene and its state with an accelerometer, and the quantity that it reads.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> found = cj.accelerometer(scene, state, "arm 2", axis=(0, 1, 0), frequency=2e3)
    >>> spring = found.scene.forces["arm 2 accelerometer spring"]
    >>> speed = np.sqrt(spring.stiffness / found.scene.bodies["arm 2 accelerometer"].mass)
    >>> round(float(speed / (2 * np.pi)), 6)  # Hz
    2000.0
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
    """Fix an accelerometer to a body: a mass that slides along an axis, on a spring and a damper.

    It reads the specific force along its axis, acceleration less gravity, through a low-pass of two
    poles: 1 / (1 + 2 z s/w + s^2/w^2) with w = 2 pi `frequency` and the damping ratio z, of which
    sqrt(1/2), the default, is Butterworth's. So impacts of microseconds become signals of the
    sensor's own width, which can be sampled and fitted. It is part of the mechanism: derivatives
    are right, it starts as at rest under gravity, and its frequency and damping, the ``stiffness``
    and ``damping`` of its spring, may be estimated.

    Steps are then a part of 1 / w long at most.

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

    - `scene`, `state`: those of the mechanism without it.
    - `body`: the name of its body; `point`: (3,) m where it sits, and `axis`: (3,) any length,
      along which it reads, in body axes.
    - `frequency`: Hz, where it damps by 3 dB (with the damping ratio unless told otherwise).
    - `damping_ratio`: positive.
    - `mass`: kg, that slides; a millionth of the body's unless given, so that the motion stays as
      it is.
    - `name`: of its body and joint; that of the body and "accelerometer" unless given. Its spring's
      has " spring" behind it.

    **Returns:** `Accelerometer`, a tuple: scene and state with it, and the quantity it reads.

    **Raises:** `ValueError` for values that no sensor can have, an unknown body or a name that is
    taken.

    **Source:** C. Harris and A. Piersol, *Harris' shock and vibration handbook* (2002), chapter 12.
    """
    name = f"{body} accelerometer" if name is None else name
    _require_names(scene, state, body, name)
    require_point("point", place := np.asarray(as_number(point, "point", "m")))
    require_axis("axis", along := np.asarray(as_number(axis, "axis")))
    direction = along / np.linalg.norm(along)
    require_positive("frequency", as_number(frequency, "frequency", "Hz"), "give it in Hz")
    require_positive("damping_ratio", as_number(damping_ratio, "damping_ratio"), "0.7 is usual")
    size = SHARE * float(scene.bodies[body].mass) if mass is None else mass
    require_positive("mass", as_number(size, "mass", "kg"), "give it in kg")
    speed = 2.0 * math.pi * frequency
    spring = SpringDamper(
        body,
        name,
        place - ARM * direction,
        np.zeros(3),
        stiffness=size * speed**2,
        damping=2.0 * damping_ratio * size * speed,
        free_length=ARM,
    )
    slide = PrismaticJoint(body, name, place, np.zeros(3), direction)
    with quiet():
        fixed = Scene(
            {**scene.bodies, name: Body(size, np.full(3, size * RADIUS**2))},
            {**scene.joints, name: slide},
            {**scene.forces, name + SPRING: spring},
            scene.gravity,
        )
    host = state.bodies[body]
    bodies = {**state.bodies, name: _resting(host, scene, place, direction, speed)}
    start = State(bodies, state.entry_speeds, state.work, state.bristles)
    return Accelerometer(fixed, start, AccelerometerReading(name))


def _require_names(scene: Scene, state: State, body: str, name: str) -> None:
    """A body that is there, and a name for its sensor that is not."""
    remedy = nearest(body, scene.bodies, "name one of them")
    require(body in scene.bodies, "body", body, f"one of {sorted(scene.bodies)}", remedy)
    require(body in state.bodies, "state", sorted(state.bodies), f"one with {body!r}", "add it")
    free = not {name, name + SPRING} & {*scene.bodies, *scene.joints, *scene.forces}
    require(free, "name", name, "one that the scene does not have", "give another name")


def _resting(
    body: BodyState, scene: Scene, place: np.ndarray, direction: np.ndarray, speed: float
) -> BodyState:
    """The state of the sensor's mass at a place of a body, (3,) m, deflected by gravity alone, with
    the spring's angular frequency, rad/s."""
    scalar, *vector = np.asarray(body.orientation, dtype=float)
    axis = np.array(vector)

    def turned(local: np.ndarray) -> np.ndarray:
        across = 2.0 * np.cross(axis, local)
        return local + scalar * across + np.cross(axis, across)

    gravity = np.zeros(3) if scene.gravity is None else np.asarray(scene.gravity)
    arm = place + direction * float(gravity @ turned(direction)) / speed**2
    spin = np.asarray(body.spin)
    return body_state(
        np.asarray(body.position) + turned(arm),
        np.asarray(body.orientation),
        np.asarray(body.velocity) + turned(np.cross(spin, arm)),
        spin,
    )
