"""Absolute coordinates, in which all ideal joints and drivers are constraints, as in P. Flores et
al., Spatial revolute joints with clearances for dynamic analysis of multi-body systems, 2006."""

from dataclasses import replace
from typing import TypeAlias

from typing_extensions import override

from .._math.rotations import euler_parameter_rates, rotation_matrix, turned
from .._math.vectors import ZERO, Matrix, Scalar, Vector
from .._model.bodies import NO_WRENCH, Body, BodyState, Wrench
from .._model.joints.base import Motions, Row
from .._model.scene import Scene
from .coordinates import AbstractMechanics, BodyAcceleration, Speeds, Wrenches, anchors
from .joint_coordinates.coordinates import AbstractBranchCoordinates, Walk, written_out
from .joint_coordinates.trees import FreeBranch

Bodies: TypeAlias = dict[str, BodyState]


class AbsoluteCoordinates(AbstractBranchCoordinates):
    """Position, Euler parameters, velocity and spin of each body; ideal joints are constraints.

    The variables are a `BodyState` for each body. If a clearance joint to the ground has an
    `AbstractContactJoint.anchor`, the position variable of the joint's moving body is the vector,
    m, from a fixed point, such as the bearing's centre, to a nearby point of the body, such as the
    journal's centre. Computed as a difference of two positions of the order of metres, this vector
    would lose digits, and impacts amplify such errors.

    >>> cj.Settings(coordinates=cj.AbsoluteCoordinates()).coordinates
    AbsoluteCoordinates()
    """

    @override
    def walk(self, scene: Scene) -> Walk:
        points = anchors(scene)
        return written_out(FreeBranch(name, points.get(name)) for name in scene.bodies)

    @override
    def eliminated(self, scene: Scene) -> frozenset[str]:
        return frozenset()

    @override
    def encode(self, scene: Scene, bodies: Bodies) -> Bodies:
        variables = dict(bodies)
        for name, (local, origin) in anchors(scene).items():
            body = bodies[name]
            position = (body.position + rotation_matrix(body.orientation) @ local) - origin
            variables[name] = replace(body, position=position)
        return variables

    @override
    def mechanics(self, scene: Scene, variables: Bodies) -> "AbsoluteMechanics":
        return AbsoluteMechanics(scene, variables, self.motions(scene, variables))


class AbsoluteMechanics(AbstractMechanics):
    """Newton-Euler equations of all bodies (P. Flores et al. 2006, eq. 29). The speeds are, for
    each body in the order of ``scene.bodies``, the velocity of the centre of mass, m/s, in global
    axes, and the spin, rad/s, in body axes. These speeds u are the velocities V, so that the
    matrix H in V = H u (see `.coordinates`) is the identity."""

    def __init__(self, scene: Scene, variables: Bodies, motions: Motions):
        self._scene, self._variables, self.motions = scene, variables, motions
        bodies = scene.bodies.items()
        self._inverses = {n: (1.0 / body.mass, _inverse_inertia(body)) for n, body in bodies}

    @override
    def free_rates(self, wrenches: Wrenches) -> Speeds:
        fall = ZERO if self._scene.gravity is None else self._scene.gravity
        loads: Wrenches = {}
        for name, body in self._scene.bodies.items():
            # The moment of the inertial forces in a uniform rotation, -spin x angular momentum.
            spin = self.motions[name].spin
            gyroscopic = body.angular_momentum(spin).cross(spin)
            loads[name] = wrenches[name] + Wrench(ZERO, gyroscopic)
        # The weights are not among the wrenches: gravity is added to the accelerations of all
        # bodies, whatever their mass.
        without_gravity = self.accelerations(self.solved(self.projected(loads))).values()
        return [part for a in without_gravity for part in (*(a.linear + fall), *a.angular)]

    @override
    def projected(self, wrenches: Wrenches) -> Speeds:
        loads = [wrenches.get(name, NO_WRENCH) for name in self._scene.bodies]
        return [part for load in loads for part in (*load.force, *load.moment)]

    @override
    def solved(self, forces: Speeds) -> Speeds:
        rates: Speeds = []
        for name, load in by_body(self._scene, forces).items():
            inverse_mass, inverse_inertia = self._inverses[name]
            rates += [*(load.linear * inverse_mass), *(inverse_inertia @ load.angular)]
        return rates

    @override
    def bias(self, row: Row) -> Scalar:
        return 0.0

    @override
    def accelerations(self, rates: Speeds) -> dict[str, BodyAcceleration]:
        return by_body(self._scene, rates)

    @override
    def variable_rates(self, rates: Speeds) -> Bodies:
        variable_rates = {}
        for name, acceleration in self.accelerations(rates).items():
            body, anchor = self._variables[name], self.motions[name].anchor
            velocity = body.velocity if anchor is None else anchor.velocity
            orientation = euler_parameter_rates(body.orientation, body.spin)
            rate = BodyState(velocity, orientation, acceleration.linear, acceleration.angular)
            variable_rates[name] = rate
        return variable_rates

    @override
    def after_displacement(self, changes: Speeds) -> Bodies:
        bodies = {}
        for name, change in by_body(self._scene, changes).items():
            body, motion, shift = self._variables[name], self.motions[name], change.linear
            if motion.anchor is not None:
                # The position variable is that of the anchor's point, which the rotation moves.
                arm_change = change.angular.cross(motion.anchor.local)
                shift = shift + motion.direction(arm_change)
            orientation = turned(body.orientation, change.angular)
            bodies[name] = replace(body, position=body.position + shift, orientation=orientation)
        return bodies

    @override
    def after_speed_change(self, changes: Speeds) -> Bodies:
        bodies = {}
        for name, change in by_body(self._scene, changes).items():
            body = self._variables[name]
            velocity, spin = body.velocity + change.linear, body.spin + change.angular
            bodies[name] = replace(body, velocity=velocity, spin=spin)
        return bodies


def by_body(scene: Scene, numbers: Speeds) -> dict[str, BodyAcceleration]:
    """Return the linear and the angular vector of each body of a scene, from a list of six numbers
    for each body in the order of `scene.bodies`."""
    return {
        name: BodyAcceleration(Vector(*numbers[k : k + 3]), Vector(*numbers[k + 3 : k + 6]))
        for k, name in zip(range(0, len(numbers), 6), scene.bodies, strict=True)
    }


def _inverse_inertia(body: Body) -> Matrix:
    if isinstance(body.inertia, Matrix):
        return body.inertia.inverse()
    x, y, z = body.inertia
    return Matrix(Vector(1.0 / x, 0.0, 0.0), Vector(0.0, 1.0 / y, 0.0), Vector(0.0, 0.0, 1.0 / z))
