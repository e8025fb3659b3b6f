"""Planar programs of planar scenes, to compare the spatial ones with.

A joint that keeps a body in a plane, a clearance joint whose two bases are taken as one, and the
slider-crank's equations of motion written out by hand. None is needed to run a planar scene.
"""

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Any
from unittest.mock import patch

import equinox as eqx
import jax.numpy as jnp

import clearjoint as cj
from clearjoint.extend import (
    UNIT_X,
    UNIT_Y,
    UNIT_Z,
    ZERO,
    AbstractContactJoint,
    AbstractContactLaw,
    AbstractMotionSubspace,
    AbstractStiffness,
    Contact,
    EulerParameters,
    Gap,
    JointState,
    Matrix,
    Motion,
    Motions,
    Relative,
    Row,
    Scalar,
    System,
    Twist,
    Vector,
    contact_normal_force,
    perpendicular,
    point_in_plane,
    within_two_turns,
)
from studies.features.program import Program


class Plane(AbstractMotionSubspace):
    """Sliding in the plane across Z and turning about Z.

    The position is the displacement's x and y, m, and the angle, rad.
    """

    point_parent: Vector
    point_child: Vector

    def encode(self, relative: Relative) -> JointState:
        """Displacement and angle, and their rates."""
        turn, place, twist = relative.orientation, relative.displacement, relative.twist
        angle = 2.0 * jnp.arctan2(turn.e3, turn.e0)
        return JointState(
            (place.x, place.y, angle), (twist.linear.x, twist.linear.y, twist.angular.z)
        )

    def orientation(self, position: Any) -> EulerParameters:
        """Turned about Z."""
        half = 0.5 * position[2]
        return EulerParameters(jnp.cos(half), 0.0, 0.0, jnp.sin(half))

    def rotation(self, position: Any) -> Matrix:
        """The same, with its zeros and one."""
        cosine, sine = jnp.cos(position[2]), jnp.sin(position[2])
        return Matrix(Vector(cosine, -sine, 0.0), Vector(sine, cosine, 0.0), UNIT_Z)

    def displacement(self, position: Any) -> Vector:
        """In the plane."""
        return Vector(position[0], position[1], 0.0)

    def columns(self, position: Any) -> tuple[Twist, ...]:
        """Two slides and a turn."""
        del position
        return Twist(ZERO, UNIT_X), Twist(ZERO, UNIT_Y), Twist(UNIT_Z, ZERO)

    def rates(self, state: JointState) -> Any:
        """The speeds."""
        return state.speeds

    def after_displacement(self, position: Any, changes: tuple[Scalar, ...]) -> Any:
        """Slid and turned."""
        return tuple(a + b for a, b in zip(position, changes, strict=True))

    def without_drift(self, position: Any) -> Any:
        """The angle within two turns."""
        return (*position[:2], within_two_turns(position[2]))


class PlanarJoint(cj.extend.AbstractConstraint):
    """A body stays in the ground's XY plane, a point of it at a small distance from a fixed one."""

    body: str = eqx.field(static=True)
    point: Any
    origin: Any

    def body_names(self) -> tuple[str, ...]:
        """The ground and the body."""
        return cj.GROUND, self.body

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """One translation and two tilts."""
        del t
        names = cj.GROUND, self.body
        pair: tuple[Motion, Motion] = motions[cj.GROUND], motions[self.body]
        return {
            "offset": point_in_plane(names, *pair, self.origin, UNIT_Z, self.point),
            "tilt 1": perpendicular(names, *pair, UNIT_Z, UNIT_X),
            "tilt 2": perpendicular(names, *pair, UNIT_Z, UNIT_Y),
        }

    def degrees_of_freedom(self, parent: str) -> Plane | None:
        """The plane's, of the body against the ground."""
        return Plane(self.origin, self.point) if parent == cj.GROUND else None


class Doubled(AbstractStiffness):
    """Twice a stiffness."""

    single: AbstractStiffness

    def value(self, gap: Gap) -> Scalar:
        """Twice the value."""
        return 2.0 * self.single.value(gap)


class OneBase(AbstractContactJoint):
    """A clearance joint of a planar motion, where both bases do the same: one, twice as stiff."""

    joint: cj.ClearanceJoint

    def body_names(self) -> tuple[str, ...]:
        """Those of the joint."""
        return self.joint.body_names()

    def pair(self) -> tuple[str, str]:
        """The bearing's body and the journal's."""
        return self.joint.pair()

    def anchor(self) -> tuple[str, Vector, Vector] | None:
        """That of the joint."""
        return self.joint.anchor()

    def laws(self) -> dict[str, AbstractContactLaw]:
        """One law."""
        law: Any = self.joint.law
        return {"V": eqx.tree_at(lambda one: one.stiffness, law, Doubled(law.stiffness))}

    def contacts(self, motions: Motions) -> dict[str, Contact]:
        """One contact."""
        return {"V": self.joint.contacts(motions)["V"]}

    def friction_force(self, name: str, contact: Contact, normal_force: Scalar) -> Vector | None:
        """None."""
        del name, contact, normal_force
        return None


def with_one_base(scene: cj.Scene) -> cj.Scene:
    """The scene with its clearance joints' bases taken as one."""
    joints = {
        name: OneBase(joint) if isinstance(joint, cj.ClearanceJoint) else joint
        for name, joint in scene.joints.items()
    }
    return cj.Scene(scene.bodies, joints, scene.forces, scene.gravity)


def planar_pendulum(held: bool) -> tuple[cj.Scene, cj.State]:
    """The paper's double pendulum with both axes along Z, from the horizontal; `held` by a
    `PlanarJoint`, or moving freely in space, where nothing moves it out of the plane."""
    inertia, half = (0.001, 0.5855, 0.5855), 0.5
    point, origin, axis = (-half, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    joints: dict[str, Any] = {
        "shoulder": cj.ClearanceJoint(
            cj.GROUND,
            "arm 2",
            journal_point=point,
            bearing_radius=10e-3,
            clearance=0.5e-3,
            journal_length=20e-3,
            law=cj.laws.LankaraniNikravesh(restitution=0.9, stiffness=cj.mechanisms.STEEL),
        ),
        "elbow": cj.RevoluteJoint("arm 2", "arm 3", (half, 0.0, 0.0), point, axis, axis),
    }
    if held:
        joints["plane"] = PlanarJoint("arm 2", jnp.asarray(point), jnp.asarray(origin))
    bodies = {name: cj.Body(7.02, inertia) for name in ("arm 2", "arm 3")}
    state = {
        "arm 2": cj.body_state((half, 0.0, 0.0)),
        "arm 3": cj.body_state((3.0 * half, 0.0, 0.0)),
    }
    return cj.Scene(bodies, joints, gravity=(0.0, 9.81, 0.0)), cj.State(state)


@dataclass(frozen=True)
class _Linkage:
    """The slider-crank at an instant, in its plane.

    `crank`: its angle from X, rad; `turn`, `swing`: angular velocities of crank and rod, rad/s, and
    `bend` their difference; `slide`: the slider's speed, m/s. `along_crank`, `along_rod`: unit
    vectors. `apart`: the rod's end less the slider's centre, m; `parting`: its rate, m/s.
    """

    crank: Scalar
    turn: Scalar
    bend: Scalar
    swing: Scalar
    slide: Scalar
    along_crank: tuple[Scalar, Scalar]
    along_rod: tuple[Scalar, Scalar]
    apart: tuple[Scalar, Scalar]
    parting: tuple[Scalar, Scalar]

    @staticmethod
    def at(variables: Any) -> "_Linkage":
        """That of the variables, of which the rod's angle is relative to the crank's."""
        crank, rod, slider = (variables[name] for name in ("crank", "rod", "slider"))
        (turn,), (bend,), (slide,) = crank.speeds, rod.speeds, slider.speeds
        swing, along = turn + bend, crank.position + rod.position
        r, length = cj.mechanisms.CRANK_LENGTH, cj.mechanisms.ROD_LENGTH
        cos_crank, sin_crank = jnp.cos(crank.position), jnp.sin(crank.position)
        cos_rod, sin_rod = jnp.cos(along), jnp.sin(along)
        x = r * cos_crank + length * cos_rod - slider.position
        y = r * sin_crank + length * sin_rod
        x_rate = -r * sin_crank * turn - length * sin_rod * swing - slide
        y_rate = r * cos_crank * turn + length * cos_rod * swing
        directions = (cos_crank, sin_crank), (cos_rod, sin_rod)
        return _Linkage(
            crank.position, turn, bend, swing, slide, *directions, (x, y), (x_rate, y_rate)
        )


def slider_crank_rates(
    system: System,
    variables: Any,
    entry_speeds: Any,
    t: Scalar,
    closed: Any = None,
) -> tuple[Any, dict[str, Scalar]]:
    """The slider-crank's equations of motion by hand.

    Angles of crank and rod (relative), and the slider's distance; both bases are pressed alike, at
    the force of base V.
    """
    scene, at = system.scene, _Linkage.at(variables)
    force, normal = _pin_force(scene, at, entry_speeds, closed)
    turn_rate, swing_rate = _angular_rates(system, at, force, normal, t)
    return {
        "crank": JointState(at.turn, (turn_rate,)),
        "rod": JointState(at.bend, (swing_rate - turn_rate,)),
        "slider": JointState(at.slide, (force * normal[0] / scene.bodies["slider"].mass,)),
    }, {}


def _pin_force(
    scene: cj.Scene, at: _Linkage, entry_speeds: Any, closed: Any
) -> tuple[Scalar, tuple[Scalar, Scalar]]:
    """The force of both bases on the slider, N, and its direction."""
    joint = scene.joints["slider pin"]
    pin: Any = joint.joint if isinstance(joint, OneBase) else joint
    (x, y), (x_rate, y_rate) = at.apart, at.parting
    distance = jnp.sqrt(jnp.maximum(x * x + y * y, 1e-300))
    n_x, n_y = x / distance, y / distance
    gap = Gap(
        distance - pin.clearance, x_rate * n_x + y_rate * n_y, pin.bearing_radius, pin.clearance
    )
    force = 2.0 * contact_normal_force(pin.law, gap, entry_speeds["slider pin"]["V"])
    if closed is not None:
        force = jnp.where(closed["slider pin"]["V"], force, 0.0)
    return force, (n_x, n_y)


def _angular_rates(
    system: System, at: _Linkage, force: Scalar, normal: tuple[Scalar, Scalar], t: Scalar
) -> tuple[Scalar, Scalar]:
    """Angular accelerations of crank and rod, rad/s^2, under a force of the rod on the slider."""
    scene, (n_x, n_y) = system.scene, normal
    (cos_crank, sin_crank), (cos_rod, sin_rod) = at.along_crank, at.along_rod
    r, length = cj.mechanisms.CRANK_LENGTH, cj.mechanisms.ROD_LENGTH
    mass, centre = scene.bodies["rod"].mass, 0.5 * length
    coupling = mass * r * centre
    moment = force * length * (n_x * sin_rod - n_y * cos_rod)
    crank_moment = force * r * (n_x * sin_crank - n_y * cos_crank)
    cos_bend = cos_rod * cos_crank + sin_rod * sin_crank
    sin_bend = sin_rod * cos_crank - cos_rod * sin_crank
    load = moment - coupling * sin_bend * at.turn * at.turn
    crank_load = crank_moment + coupling * sin_bend * at.swing * at.swing
    inertia = scene.bodies["rod"].inertia.z + mass * centre * centre
    if "motor" in scene.joints:
        turn_rate = _driven_rate(system, at, t)
    else:
        body, mixed = scene.bodies["crank"], coupling * cos_bend
        own = body.inertia.z + body.mass * (0.5 * r) ** 2 + mass * r * r
        turn_rate = (crank_load * inertia - mixed * load) / (own * inertia - mixed * mixed)
    return turn_rate, (load - coupling * cos_bend * turn_rate) / inertia


def _driven_rate(system: System, at: _Linkage, t: Scalar) -> Scalar:
    """The angular acceleration of a crank that a motor turns, rad/s^2."""
    motor: Any = system.scene.joints["motor"]
    error = at.crank - motor.angle(t)
    wrapped = error - 2.0 * math.pi * jnp.round(error / (2.0 * math.pi))
    return system.formulation.stabilisation.target(wrapped, at.turn - motor.speed)


def planar_programs() -> dict[str, dict[str, Program]]:
    """Programs by scene and name, the spatial one first."""
    (free, start), (held, _) = planar_pendulum(False), planar_pendulum(True)
    driven, turning = cj.mechanisms.slider_crank()
    return {
        "double pendulum": {
            "spatial": Program.of(free, start),
            "held in the plane": Program.of(held, start),
            "held in the plane, one base": Program.of(with_one_base(held), start),
        },
        "slider-crank, driven": _slider_crank_programs(driven, turning),
        "slider-crank, coasting": _slider_crank_programs(without_motor(driven), turning),
    }


def _slider_crank_programs(scene: cj.Scene, state: cj.State) -> dict[str, Program]:
    single = Program.of(with_one_base(scene), state)
    by_hand = partial(patch.object, System, "rates", slider_crank_rates)
    return {
        "spatial": Program.of(scene, state),
        "one base": single,
        "by hand, one base": replace(single, inside=by_hand),
    }


def without_motor(scene: cj.Scene) -> cj.Scene:
    """The scene without its joint "motor"."""
    joints = {name: joint for name, joint in scene.joints.items() if name != "motor"}
    return cj.Scene(scene.bodies, joints, scene.forces, scene.gravity)
