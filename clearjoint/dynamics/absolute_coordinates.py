"""Absolute coordinates: position, orientation, velocity and spin of each body.

All ideal joints are constraints, as in Flores et al. 2006, whose equation numbers are cited. The
spin of a body is its angular velocity in body axes, rad/s. The speeds are velocities and spins of
all bodies; arguments and results of the type `Speeds` are lists with six numbers for each body.
"""

from typing import TypeAlias

from ..math.rotations import euler_parameter_rates, rotation_matrix, turned
from ..math.vectors import ZERO, Matrix, Scalar, Vector
from ..model.bodies import GROUND, GROUND_MOTION, NO_WRENCH, Body, BodyState, Motion, Wrench
from ..model.joints.base import Motions, Row
from ..model.scene import Scene
from .coordinates import (
    AbstractCoordinates,
    AbstractMechanics,
    BodyAcceleration,
    Speeds,
    Wrenches,
    anchors,
    body_with_speeds,
    free_motion,
    normalised_body,
)

Bodies: TypeAlias = dict[str, BodyState]


class AbsoluteCoordinates(AbstractCoordinates):
    """Position, Euler parameters, velocity and spin of each body, with all ideal joints as
    constraints.

    The variables are a `BodyState` for each body, by name. Its position is the centre of mass, m,
    in global coordinates. For a body with a clearance joint to the ground, which has an `Anchor`,
    the position is instead the vector from the bearing's centre to the journal's. Computed as a
    difference of two positions of the order of metres, this vector would lose digits, and impacts
    amplify such errors.

    >>> cj.Settings(coordinates=cj.AbsoluteCoordinates()).coordinates
    AbsoluteCoordinates()
    """

    def eliminated(self, scene: Scene) -> frozenset[str]:
        """Return an empty set: no joint is eliminated."""
        del scene
        return frozenset()

    def encode(self, scene: Scene, bodies: Bodies) -> Bodies:
        """Return the variables for given states of the bodies, by name.

        They are the states themselves, except that the position of a body with an `Anchor` is the
        vector, m, from the anchor's ground point to its body point.
        """
        points = anchors(scene)

        def encoded(name: str, body: BodyState) -> BodyState:
            if name not in points:
                return body
            local, origin = points[name]
            arm = rotation_matrix(body.orientation) @ local
            return BodyState(
                (body.position + arm) - origin, body.orientation, body.velocity, body.spin
            )

        return {name: encoded(name, body) for name, body in bodies.items()}

    def decode(self, scene: Scene, variables: Bodies) -> Bodies:
        """Return the states of the bodies, by name, in which all positions are those of the centres
        of mass, m."""
        motions = self.motions(scene, variables)
        return {
            name: BodyState(motions[name].position, body.orientation, body.velocity, body.spin)
            for name, body in variables.items()
        }

    def motions(self, scene: Scene, variables: Bodies) -> Motions:
        """Return pose and velocities of each body and of "ground", by name."""
        points = anchors(scene)
        free = {name: free_motion(body, points.get(name)) for name, body in variables.items()}
        return {GROUND: GROUND_MOTION, **free}

    def mechanics(self, scene: Scene, variables: Bodies) -> "AbsoluteMechanics":
        """Return the equations of motion of the bodies (eq. 29)."""
        return AbsoluteMechanics(scene, variables, self.motions(scene, variables))

    def without_drift(self, scene: Scene, variables: Bodies) -> Bodies:
        """Return the variables with Euler parameters of unit norm."""
        del scene
        return {name: normalised_body(body) for name, body in variables.items()}

    def with_speeds(self, scene: Scene, variables: Bodies, others: Bodies) -> Bodies:
        """Return positions and orientations of `variables` with velocities and spins of
        `others`."""
        del scene
        return {name: body_with_speeds(body, others[name]) for name, body in variables.items()}


class AbsoluteMechanics(AbstractMechanics):
    """Newton-Euler equations of all bodies.

    The speeds are six numbers for each body, in the order of ``scene.bodies``: velocity of the
    centre of mass, m/s, in global axes, and spin, rad/s, in body axes. The matrix H that maps
    speeds to velocities and spins is therefore the identity.
    """

    def __init__(self, scene: Scene, variables: Bodies, motions: Motions):
        self._scene, self._variables, self.motions = scene, variables, motions
        self._inverses = {name: InverseMass(body) for name, body in scene.bodies.items()}

    def free_rates(self, wrenches: Wrenches) -> Speeds:
        """Return the rates of the speeds, six for each body, under wrenches, gyroscopic moments and
        gravity, without constraints."""
        fall = ZERO if self._scene.gravity is None else self._scene.gravity
        rates: Speeds = []
        for name, body in self._scene.bodies.items():
            load = wrenches[name] + _gyroscopic(body, self.motions[name])
            acceleration = self._inverses[name](load)
            rates += [*(acceleration.linear + fall), *acceleration.angular]
        return rates

    def projected(self, wrenches: Wrenches) -> Speeds:
        """Return the wrenches as six numbers for each body, force and moment; zeros for a body
        without a wrench."""
        loads = [wrenches.get(name, NO_WRENCH) for name in self._scene.bodies]
        return [part for load in loads for part in (*load.force, *load.moment)]

    def solved(self, forces: Speeds) -> Speeds:
        """Return the rates of the speeds that generalised forces cause, six for each body: force
        over mass, m/s^2, and inverse inertia times moment, rad/s^2."""
        rates: Speeds = []
        for name, load in by_body(self._scene, forces).items():
            acceleration = self._inverses[name](Wrench(load.linear, load.angular))
            rates += [*acceleration.linear, *acceleration.angular]
        return rates

    def bias(self, row: Row) -> Scalar:
        """Return zero: if the rates of all speeds are zero, no body accelerates."""
        del row
        return 0.0

    def accelerations(self, rates: Speeds) -> dict[str, BodyAcceleration]:
        """Return the acceleration of each body, by name: its six numbers of `rates`."""
        return by_body(self._scene, rates)

    def variable_rates(self, rates: Speeds) -> Bodies:
        """Return the time derivatives of each body's variables, by name, as a `BodyState`.

        They are the velocity (of the anchor's body point, if the body has an anchor), the rates of
        the Euler parameters, and the accelerations that `rates` gives.
        """
        variable_rates = {}
        for name, acceleration in self.accelerations(rates).items():
            body, anchor = self._variables[name], self.motions[name].anchor
            variable_rates[name] = BodyState(
                body.velocity if anchor is None else anchor.velocity,
                euler_parameter_rates(body.orientation, body.spin),
                acceleration.linear,
                acceleration.angular,
            )
        return variable_rates

    def after_displacement(self, changes: Speeds) -> Bodies:
        """Return the variables after a small displacement.

        **Arguments:** `changes`: six numbers for each body, a shift in m, in global axes, and a
        rotation vector in rad, in body axes.
        """
        bodies = {}
        for name, change in by_body(self._scene, changes).items():
            body, motion, shift = self._variables[name], self.motions[name], change.linear
            if motion.anchor is not None:
                # The position variable is that of the anchor's point, which the rotation moves.
                arm_change = change.angular.cross(motion.anchor.local)
                shift = shift + motion.direction(arm_change)
            orientation = turned(body.orientation, change.angular)
            bodies[name] = BodyState(body.position + shift, orientation, body.velocity, body.spin)
        return bodies

    def after_speed_change(self, changes: Speeds) -> Bodies:
        """Return the variables with `changes` added to the velocities, m/s, and spins, rad/s, six
        numbers for each body."""
        bodies = {}
        for name, change in by_body(self._scene, changes).items():
            body = self._variables[name]
            velocity, spin = body.velocity + change.linear, body.spin + change.angular
            bodies[name] = BodyState(body.position, body.orientation, velocity, spin)
        return bodies


def by_body(scene: Scene, numbers: Speeds) -> dict[str, BodyAcceleration]:
    """Return a list with six numbers for each body as two vectors for each body, by name."""
    return {
        name: BodyAcceleration(Vector(*numbers[k : k + 3]), Vector(*numbers[k + 3 : k + 6]))
        for k, name in zip(range(0, len(numbers), 6), scene.bodies, strict=True)
    }


class InverseMass:
    """Function that maps a wrench on a free body to the body's acceleration, without gyroscopic
    terms."""

    def __init__(self, body: Body):
        self._inverse = 1.0 / body.mass
        self._tensor: Matrix | None = None
        if isinstance(body.inertia, Matrix):
            self._tensor = body.inertia.inverse()
        else:
            moments = body.inertia
            self._principal = Vector(1.0 / moments.x, 1.0 / moments.y, 1.0 / moments.z)

    def __call__(self, wrench: Wrench) -> BodyAcceleration:
        """Return the acceleration of the centre of mass, m/s^2 in global axes, and the rate of the
        spin, rad/s^2 in body axes, that a wrench causes."""
        if self._tensor is not None:
            angular = self._tensor @ wrench.moment
        else:
            angular = wrench.moment.componentwise_product(self._principal)
        return BodyAcceleration(wrench.force * self._inverse, angular)


def _gyroscopic(body: Body, motion: Motion) -> Wrench:
    """Return the gyroscopic moment on a body that rotates freely, N m, in body axes, as a wrench
    without a force."""
    return Wrench(ZERO, body.angular_momentum(motion.spin).cross(motion.spin))
