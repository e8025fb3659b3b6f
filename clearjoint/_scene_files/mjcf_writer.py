"""Write scenes and robots as MJCF files, with play by MuJoCo's recipe.

A body's frame in the file is that of the scene: its origin is the centre of mass. Positions of
hinges and sliders are those of the scene's joints: the attribute `ref` has those of the pose that
the file describes.

Flanks are limits of a hinge or, between bodies that are not parent and child, of a fixed tendon,
whose length is a sum of hinges' angles. With the limit, MuJoCo accelerates the joint by

    (1 - d) a - b v - k r,

where d is the limit's impedance, a the acceleration without it, r the penetration and v its rate;
k and b are the negative numbers of `solreflimit`. An impedance near one, as by default, fixes the
acceleration: a load hardly deflects the limit. With an impedance near zero, the limit is a spring
and damper, whose force does not depend on the load: its stiffness is k over the inverse inertia
that MuJoCo computes when it compiles the file (`dof_invweight0`, `tendon_invweight0`), in any pose.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from itertools import chain
from pathlib import Path
from typing import NamedTuple, TypeAlias
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from .._dynamics.assembly import check_names
from .._dynamics.coordinates import free_motion
from .._dynamics.joint_coordinates.trees import (
    UPRIGHT,
    FreeBranch,
    JointedBranch,
    Place,
    TreeBranch,
    topology,
)
from .._fields.cautions import NotCarriedOverWarning, caution, quiet
from .._fields.checks import require, require_positive, require_type
from .._math.rotations import composed, conjugate, rotation_matrix, unit
from .._math.smoothing import wrapped
from .._math.vectors import Vector, pack, unpack
from .._model.bodies import GROUND, GROUND_MOTION, Body, State
from .._model.clearance_joints.backlash import Backlash
from .._model.clearance_joints.between_walls import PinInSlot
from .._model.contact.dashpots import AbstractDashpotLaw
from .._model.contact.laws import AbstractContactLaw, Gap
from .._model.drives.drivers import DriveTorque, Motor, PrescribedAngle, PrescribedTranslation
from .._model.drives.functions_of_time import Polynomial, as_function_of_time, value_at
from .._model.forces import Bushing, SpringDamper, TorsionalSpring
from .._model.joints.base import AbstractContactJoint
from .._model.joints.couplings import HingeOrSlider, JointCoupling
from .._model.joints.ideal import FixedJoint, RevoluteJoint, SphericalJoint
from .._model.joints.joint_friction import JointFriction
from .._model.joints.motion_subspaces import Ball, Hinge, Slider, Weld
from .._model.scene import Scene
from .._simulation.run.run_checks import check_precision
from .._simulation.run.wall_impact import free_impact
from .documents import FileLocation, listed
from .drive_train import motor_name
from .files import FilePath
from .mjcf import mujoco_package
from .robot import Robot

SOFT, STIFF = "0.0001 0.0001 0.001 0.5 1", "0.9999 0.9999 0.001 0.5 1"
"""`solimp` of flanks, with the smallest impedance that MuJoCo accepts, and of other constraints and
of dry friction, which would creep."""
QUICK = "0.001 1"
"""`solref` of equality constraints and of dry friction. MuJoCo takes at least two time steps as the
first number, s."""
LARGEST_PENETRATION = 0.1
"""Penetration up to which a linear law replaces that of flanks, over the play."""
STEPS_A_PERIOD, LONGEST_STEP = 20.0, 2e-3
"""Default time steps in a period of the stiffest flank, and the longest one, s."""
PARALLEL, IN_PLACE = 1e-9, 1e-6
"""Largest deviation of the cosine of parallel axes from one, and of bodies from their joints, m."""
LEAST_RESTITUTION = 1e-4
"""Smallest restitution of a limit, whose damping ratio is about 10."""
LARGEST_DEGREE = 4
"""Largest degree of the polynomials by which joints of MJCF files follow others."""
LEVER = 0.1
"""Distance, m, of the points that hold a hinge that closes a loop."""
TURN = 2.0 * math.pi
HINGE, SLIDE = "hinge", "slide"
Control: TypeAlias = Callable[[jax.Array], jax.Array]
"""Control of an actuator as a function of the time, s."""


class FileJoint(NamedTuple):
    """A hinge or slider of the file.

    `axis`: in the pose of the file, (3,) in global axes. `position`: rad or m, in this pose.
    `sign`: of the file's position relative to that of the carried body on its parent.
    """

    kind: str
    element: Element
    axis: np.ndarray
    position: float
    sign: float


class JointOrTendon(NamedTuple):
    """A joint or fixed tendon of the file, on which an element of the scene acts.

    `sign`: of its position relative to that of the element. `position`: in the pose of the file,
    rad or m.
    """

    element: Element
    sign: float
    position: float


class Flank(NamedTuple):
    """A pair of flanks: joint or tendon, stiffness, N m/rad or N/m, and, as a function of the
    inertia, kg m^2 or kg, the damping, N m s/rad or N s/m."""

    element: Element
    stiffness: float
    damping: Callable[[float], float]


def _text(*numbers: PyTree) -> str:
    parts = chain.from_iterable(np.ravel(np.asarray(pack(part), dtype=float)) for part in numbers)
    return " ".join(repr(float(part) + 0.0) for part in parts)  # no negative zeros


def _global(motion, axis: Vector) -> np.ndarray:  # noqa: ANN001
    return np.asarray(pack(motion.direction(unit(axis))), dtype=float)


class MjcfWriter:
    """The file of a scene, whose bodies are in a `pose`.

    - `omitted`: names of elements of the scene that have no counterpart, by title.
    - `controls`: of the actuators that are forces of the scene, by name.
    - `joints`: names of the file's joints by that of the body that they carry.
    """

    def __init__(self, scene: Scene, places: Iterable[Place], pose: State):
        self.omitted: dict[str, list[str]] = defaultdict(list)
        self.controls: dict[str, Control] = {}
        self.joints: dict[str, str] = {}
        self.root = Element("mujoco", model="clearjoint")
        SubElement(self.root, "compiler", angle="radian", inertiafromgeom="false")
        gravity = (0.0, 0.0, 0.0) if scene.gravity is None else scene.gravity
        self.option = SubElement(self.root, "option", gravity=_text(gravity))
        self._bodies = {GROUND: SubElement(self.root, "worldbody")}
        self._coordinates: dict[str, FileJoint] = {}
        self._flanks: list[Flank] = []
        self._tendons: dict[tuple[tuple[str, float], ...], JointOrTendon] = {}
        self._scene = unpack(jax.tree.map(np.asarray, scene))
        self._branches = {place.body: self._branch(place) for place in places}
        self._motions, self._turns = {GROUND: GROUND_MOTION}, {GROUND: UPRIGHT}
        self._start = self._variables(pose)
        for body in self._branches:
            self._add_body(body)
        in_tree = {b.joint for b in self._branches.values() if isinstance(b, JointedBranch)}
        # In the order of the scene: JAX has sorted the dictionaries of the other.
        for name in (*scene.joints, *scene.forces):
            element = (self._scene.joints | self._scene.forces)[name]
            write = WRITERS.get(type(element))
            if name in in_tree or (write is not None and write(self, name, element)):
                continue
            self.omitted[type(element).__name__].append(name)

    def _branch(self, place: Place) -> TreeBranch:
        body, parent, name = place
        if name is None:
            return FreeBranch(body, None)
        subspace = self._scene.joints[name].motion_subspace(parent)
        if isinstance(subspace, Hinge | Slider | Ball | Weld):
            return JointedBranch(body, parent, name, subspace)
        return FreeBranch(body, None)

    def _variables(self, state: State) -> dict[str, PyTree]:
        """Return a `JointState` for each carried body, and a `BodyState` for each free one."""
        (first, *_) = state.bodies.values()
        bodies = unpack(jax.tree.map(np.asarray, state), np.ndim(first.position) - 1).bodies
        poses, variables = {GROUND: (UPRIGHT, GROUND_MOTION)}, {}
        for name, branch in self._branches.items():
            poses[name] = bodies[name].orientation, free_motion(bodies[name], None)
            variables[name] = branch.encode(poses[branch.parent], poses[name])
        return variables

    def motion(self, state: State) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Return numbers (..., n) of position and speed of each joint of the file, by name, for
        states of the scene."""
        numbers = {}
        for body, variable in self._variables(state).items():
            coordinate = self._coordinates.get(body)
            if coordinate is not None:
                (position,) = jax.tree.leaves(variable.position)
                position, speed = (coordinate.sign * x for x in (position, *variable.speeds))
                if coordinate.kind == HINGE:
                    limits = coordinate.element.get("range")
                    near = np.mean([*map(float, limits.split())]) if limits else coordinate.position
                    position = position - TURN * np.round((position - near) / TURN)
                    position = np.unwrap(position) if np.ndim(position) else position
                parts = (position,), (speed,)
            elif isinstance(self._branches[body], FreeBranch):
                parts = (
                    (variable.position, variable.orientation),
                    (variable.velocity, variable.spin),
                )
            elif body in self.joints:
                turn = composed(conjugate(self._start[body].position), variable.position)
                parts = turn, variable.speeds
            else:
                continue
            numbers[self.joints[body]] = tuple(
                np.stack(np.broadcast_arrays(*jax.tree.leaves(part)), axis=-1) for part in parts
            )
        return numbers

    def require_in_place(self, state: State) -> None:
        """Raise a `ValueError` unless bodies are where the joints of the tree allow them."""
        for name, motion in self._motions.items():
            if name != GROUND:
                off = np.asarray(state.bodies[name].position) - pack(motion.position)
                joint = f"on the joint of {name!r}, within {IN_PLACE} m"
                remedy = "correct the state with `assemble`"
                require(np.abs(off).max() < IN_PLACE, "state", off, joint, remedy)

    def _add_body(self, name: str) -> None:
        branch, variable = self._branches[name], self._start[name]
        parent, parents_turn = self._motions[branch.parent], self._turns[branch.parent]
        motion = branch.motion(parent, variable)
        turn = branch.orientation(parents_turn, variable)
        self._motions[name], self._turns[name] = motion, turn
        place = parent.components(motion.position - parent.position)
        element = SubElement(
            self._bodies[branch.parent],
            "body",
            name=name,
            pos=_text(place),
            quat=_text(composed(conjugate(parents_turn), turn)),
        )
        self._bodies[name] = element
        body: Body = self._scene.bodies[name]
        inertia, armature = np.asarray(pack(body.inertia), dtype=float), None
        if isinstance(branch, FreeBranch):
            self.joints[name] = f"{name} free"
            SubElement(element, "freejoint", name=self.joints[name])
        elif not isinstance(branch.motion_subspace, Weld):
            armature = self._add_joint(name, element, branch)
        # MuJoCo refuses the negligible mass and inertia of the rotor of a drive train.
        least = 0.0 if armature is None else 2e-15
        moments = {"diaginertia": np.maximum(inertia, least)}
        if inertia.ndim == 2:
            xx, yy, zz = np.diag(inertia)
            moments = {"fullinertia": (xx, yy, zz, inertia[0, 1], inertia[0, 2], inertia[1, 2])}
        SubElement(
            element,
            "inertial",
            pos="0 0 0",
            mass=_text(max(float(body.mass), least)),
            **{key: _text(numbers) for key, numbers in moments.items()},
        )

    def _add_joint(self, body: str, element: Element, branch: JointedBranch) -> PyTree:
        """Add a hinge, slider or ball, and return its armature."""
        subspace, joint = branch.motion_subspace, self._scene.joints[branch.joint]
        self.joints[body] = branch.joint
        options = {"name": branch.joint, "pos": _text(subspace.point_child)}
        if isinstance(subspace, Ball):
            SubElement(element, "joint", type="ball", **options)
            return None
        assert isinstance(subspace, Hinge | Slider)
        kind = HINGE if isinstance(subspace, Hinge) else SLIDE
        sign = 1.0 if joint.body_names()[0] == branch.parent else -1.0
        position = sign * float(self._start[body].position)
        written = SubElement(
            element,
            "joint",
            type=kind,
            axis=_text(subspace.axis * sign),
            ref=_text(position),
            **options,
        )
        armature = getattr(joint, "armature", None)
        if armature is not None:
            written.set("armature", _text(armature))
        axis = _global(self._motions[body], subspace.axis * sign)
        self._coordinates[body] = FileJoint(kind, written, axis, position, sign)
        return armature

    def _target(
        self, name: str, kind: str, pair: tuple[str, str], axis: np.ndarray
    ) -> JointOrTendon | None:
        """Return the joint or tendon whose position is that of the second body of a pair relative
        to the first, about or along a global axis; ``None`` unless all joints between them have
        this axis. `name`: of a new tendon."""
        sides: dict[str, float] = defaultdict(float)
        for body, side in zip(pair, (-1.0, 1.0), strict=True):
            while body != GROUND:
                sides[body] += side
                body = self._branches[body].parent
        signs = {}
        for body, side in sides.items():
            coordinate = self._coordinates.get(body)
            if not side or (coordinate is None and self.joints.get(body) is None):
                continue  # common to both bodies, or fixed to its parent
            cosine = 0.0 if coordinate is None else float(coordinate.axis @ axis)
            if coordinate is None or coordinate.kind != kind or abs(cosine) < 1.0 - PARALLEL:
                return None
            signs[body] = side * np.sign(cosine)
        if not signs:
            return None
        (body, first), *others = parts = [(b, signs[b]) for b in self._branches if b in signs]
        if not others:
            joint = self._coordinates[body]
            return JointOrTendon(joint.element, first, joint.position)
        key = tuple((body, first * sign) for body, sign in parts)
        if key not in self._tendons:
            tendon = SubElement(self._section("tendon"), "fixed", name=name)
            for body, sign in key:
                SubElement(tendon, "joint", joint=self.joints[body], coef=_text(sign))
            position = sum(sign * self._coordinates[body].position for body, sign in key)
            self._tendons[key] = JointOrTendon(tendon, 1.0, position)
        return self._tendons[key]._replace(sign=first)

    def _section(self, name: str) -> Element:
        section = self.root.find(name)
        return SubElement(self.root, name) if section is None else section

    def _pair_target(
        self, name: str, kind: str, element: PyTree, axis: Vector
    ) -> JointOrTendon | None:
        first, second = element.pair()
        return self._target(name, kind, (first, second), _global(self._motions[first], axis))

    def _limit(self, target: JointOrTendon, offset: float, play: float, flank: Flank) -> bool:
        """Limit a target to a play, from whose middle it is displaced by `offset` in the pose."""
        middle = target.position - target.sign * offset
        lower, upper = middle - 0.5 * play, middle + 0.5 * play
        written = target.element.get("range")
        if written is not None:
            # Of two, such as a play and the stops of the joint, the narrower one acts.
            other_lower, other_upper = map(float, written.split())
            if other_upper - other_lower < play:
                return True
            self._flanks = [f for f in self._flanks if f.element is not target.element]
        target.element.set("range", _text(lower, upper))
        self._flanks.append(flank)
        return True

    def _linear(
        self, name: str, law: AbstractContactLaw, play: float, lever: float
    ) -> tuple[float, Callable[[float], float]]:
        """Return stiffness and damping of a law, N/m and N s/m times the square of the lever, m."""
        depth = LARGEST_PENETRATION * play * lever
        stiffness, half = (
            2.0 * float(law.stored_energy(Gap(x, 0.0))) / x**2 for x in (depth, 0.5 * depth)
        )
        if abs(stiffness - half) > 1e-9 * stiffness:
            self.omitted["nonlinear stiffness of flanks"].append(name)

        def damping(inertia: float) -> float:
            mass = inertia / lever**2
            if isinstance(law, AbstractDashpotLaw) and law.damping_exponent == 0.0:
                return float(law.damping(Gap(depth, 0.0))) * lever**2
            if hasattr(law, "delivered_restitution"):
                restitution = float(law.delivered_restitution())  # pyright: ignore
            else:
                speed = depth * math.sqrt(stiffness / mass)
                restitution = free_impact(law, mass, speed).restitution
            ratio = _damping_ratio(restitution)
            return 2.0 * ratio * math.sqrt(stiffness * mass) * lever**2

        return stiffness * lever**2, damping

    def backlash(self, name: str, joint: Backlash) -> bool:
        target = self._pair_target(name, HINGE, joint, joint.axis_first)
        if target is None:
            return False
        play, lever = float(joint.play), float(joint.radius)
        offset = float(joint.centred_rows(self._motions)["angle"].value)
        flank = Flank(target.element, *self._linear(name, joint.law, play, lever))
        return self._limit(target, offset, play, flank)

    def pin_in_slot(self, name: str, joint: PinInSlot) -> bool:
        """Write the ends of a slot along a slider, as of the stops of a robot."""
        target = self._pair_target(name, SLIDE, joint, joint.slot_axis)
        if joint.travel is None or target is None:
            return False
        travel, (slot, pin) = float(joint.travel), (self._motions[body] for body in joint.pair())
        apart = pin.point(joint.pin_point) - slot.point(joint.slot_point)
        offset = float(apart.dot(slot.direction(unit(joint.slot_axis))))
        flank = Flank(target.element, *self._linear(name, joint.law, travel, 1.0))
        return self._limit(target, offset, travel, flank)

    def _resist(
        self,
        target: JointOrTendon,
        stiffness: float = 0.0,
        damping: float = 0.0,
        friction: float = 0.0,
        stretch: float = 0.0,
    ) -> bool:
        """Add a spring, stretched by `stretch` in the pose, a damper and dry friction."""
        element = target.element
        rest = "springref" if element.tag == "joint" else "springlength"
        if stiffness:
            before = float(element.get("stiffness", 0.0))
            relaxed = target.position - target.sign * stretch
            moment = before * float(element.get(rest, "0").split()[0]) + stiffness * relaxed
            mean = moment / (before + stiffness)
            element.set(rest, _text(*[mean] * (1 if element.tag == "joint" else 2)))
        parts = {"stiffness": stiffness, "damping": damping, "frictionloss": friction}
        for key, value in parts.items():
            if value:
                element.set(key, _text(value + float(element.get(key, 0.0))))
        if friction:
            element.set("solimpfriction", STIFF)
            element.set("solreffriction", QUICK)
        return True

    def torsional_spring(self, name: str, force: TorsionalSpring) -> bool:
        target = self._pair_target(name, HINGE, force, force.axis)
        if target is None:
            return False
        angle = force.relative_angle(self._motions).value
        stretch = float(wrapped(angle - force.rest_angle, TURN))
        return self._resist(target, float(force.stiffness), float(force.damping), 0.0, stretch)

    def bushing(self, name: str, force: Bushing) -> bool:
        """Write the spring and damper of a slider, whose motion strains a bushing along one
        axis."""
        # One of the two bodies is the last on the way from the other.
        carried = (self._coordinates.get(body) for body in force.pair())
        axes = [c.axis for c in carried if c is not None]
        targets = [(axis, self._target(name, SLIDE, force.pair(), axis)) for axis in axes]
        targets = [(axis, target) for axis, target in targets if target is not None]
        if not targets:
            return False
        axis, target = targets[0]
        first, second = (self._motions[body] for body in force.pair())
        axes = rotation_matrix(composed(self._turns[force.first], force.orientation_first))
        frame = np.asarray(pack(axes), dtype=float)
        along = axis @ frame
        stiffness, damping = (float(along**2 @ pack(k)) for k in (force.stiffness, force.damping))
        apart = pack(second.point(force.point_second) - first.point(force.point_first))
        # The points may also be apart across the axis, which pulls along it.
        pull = along * pack(force.stiffness) @ (apart @ frame)
        stretch = float(pull) / stiffness if stiffness else 0.0
        return self._resist(target, stiffness, damping, 0.0, stretch)

    def friction(self, name: str, joint: JointFriction) -> bool:
        if joint.axis is None:
            return False
        kind, lever = (SLIDE, 1.0) if joint.radius is None else (HINGE, float(joint.radius))
        target = self._pair_target(name, kind, joint, joint.axis)
        if target is None:
            return False
        law, load = joint.friction, float(joint.load)
        sliding = -float(law.force(load, Vector(1.0, 0.0, 0.0)).x)
        if float(getattr(law, "breakaway", 0.0)) > float(getattr(law, "kinetic", math.inf)):
            self.omitted["friction at rest above that in sliding"].append(name)
        viscosity = 0.0 if joint.viscosity is None else float(joint.viscosity)
        viscosity += load * float(getattr(law, "viscosity", 0.0))
        return self._resist(target, 0.0, viscosity * lever**2, sliding * lever)

    def spring_damper(self, name: str, force: SpringDamper) -> bool:
        options = {"springlength": _text(force.free_length, force.free_length)}
        tendon = SubElement(self._section("tendon"), "spatial", name=name, **options)
        tendon.set("stiffness", _text(force.stiffness))
        tendon.set("damping", _text(force.damping))
        for body, end, point in (
            (force.first, "first", force.point_first),
            (force.second, "second", force.point_second),
        ):
            SubElement(tendon, "site", site=self._site(body, f"{name} {end}", point))
        return True

    def _site(self, body: str, name: str, point: PyTree, turn: PyTree = UPRIGHT) -> str:
        place = {"pos": _text(point), "quat": _text(turn)}
        SubElement(self._bodies[body], "site", name=name, **place)
        return name

    def _actuate(
        self,
        name: str,
        force: DriveTorque | Motor,
        gain: float,
        damping: float,
        control: Control,
        limit: PyTree = None,
    ) -> bool:
        """Write a torque gain (control - angle) - damping speed, or the control if `gain` is 0."""
        target = self._pair_target(name, HINGE, force, force.axis)
        if target is None:
            return False
        is_joint = target.element.tag == "joint"
        zero = float(force.relative_angle(self._motions).value) - target.sign * target.position
        options = {"joint" if is_joint else "tendon": target.element.attrib["name"]}
        # The gear is the sign, so that the actuator's length is the angle less `zero`.
        bias = -gain * zero, -gain, -damping
        options |= {"gear": _text(target.sign, *[0.0] * 5), "gainprm": _text(gain or 1.0)}
        if gain or damping:
            options |= {"biastype": "affine", "biasprm": _text(bias)}
        if limit is not None:
            options["forcerange"] = _text(-limit, limit)
        SubElement(self._section("actuator"), "general", name=name, **options)
        self.controls[name] = control
        return True

    def drive_torque(self, name: str, force: DriveTorque) -> bool:
        return self._actuate(name, force, 0.0, 0.0, partial(value_at, force.torque))

    def motor(self, name: str, force: Motor) -> bool:
        """Write a position servo, whose control is the target plus a lead for its rate."""
        gain, damping = float(force.proportional), float(force.derivative)
        function = partial(value_at, as_function_of_time(force.target))

        def control(t: jax.Array) -> jax.Array:
            value, rate = jax.jvp(function, (t,), (jnp.ones_like(t),))
            return value + damping / gain * rate if gain else damping * rate

        return self._actuate(name, force, gain, damping, control, force.torque_limit)

    def _equate(
        self, name: str, follower: JointOrTendon, leader: JointOrTendon | None, polynomial
    ) -> bool:  # noqa: ANN001
        """Write an equation between displacements from the pose."""
        targets = [follower] if leader is None else [follower, leader]
        tags = {target.element.tag for target in targets}
        coefficients = polynomial.trim().coef
        if len(tags) > 1 or len(coefficients) > LARGEST_DEGREE + 1:
            return False
        tag = "joint" if tags == {"joint"} else "tendon"
        ends = {f"{tag}{k + 1}": t.element.attrib["name"] for k, t in enumerate(targets)}
        padded = np.pad(coefficients, (0, LARGEST_DEGREE + 1 - len(coefficients)))
        options = {"polycoef": _text(padded), "solref": QUICK, "solimp": STIFF}
        SubElement(self._section("equality"), tag, name=name, **ends, **options)
        return True

    def coupling(self, name: str, joint: JointCoupling) -> bool:
        follower, leader = (self._of_joint(name, end) for end in (joint.follower, joint.leader))
        function = as_function_of_time(joint.function)
        if follower is None or leader is None or not isinstance(function, Polynomial):
            return False
        polynomial = np.polynomial.Polynomial(np.asarray(function.coefficients))
        y, x = (float(end.position(self._motions).value) for end in (joint.follower, joint.leader))
        shifted = polynomial(np.polynomial.Polynomial([x, leader.sign])) - y
        if isinstance(joint.follower, RevoluteJoint):
            shifted -= shifted.coef[0] - wrapped(shifted.coef[0], TURN)
        return self._equate(name, follower, leader, follower.sign * shifted)

    def _of_joint(self, name: str, joint: HingeOrSlider) -> JointOrTendon | None:
        if isinstance(joint, RevoluteJoint):
            return self._pair_target(name, HINGE, joint, joint.axis_first)
        return self._pair_target(name, SLIDE, joint, joint.axis)

    def prescribed(self, name: str, drive: PrescribedAngle | PrescribedTranslation) -> bool:
        function = as_function_of_time(drive.function)
        kind = HINGE if isinstance(drive, PrescribedAngle) else SLIDE
        target = self._pair_target(name, kind, drive, drive.axis)
        is_constant = isinstance(function, Polynomial) and len(function.coefficients) == 1
        if target is None or not is_constant:
            return False
        (row,) = drive.rows(self._motions, 0.0).values()
        back = np.polynomial.Polynomial([-target.sign * float(row.value)])
        return self._equate(name, target, None, back)

    def closing(self, name: str, joint: SphericalJoint | FixedJoint | RevoluteJoint) -> bool:
        """Write a joint that closes a loop; a hinge as two points on its axis."""
        turn = joint.orientation if isinstance(joint, FixedJoint) else UPRIGHT
        points = {name: (joint.point_first, joint.point_second)}
        if isinstance(joint, RevoluteJoint):
            ends = zip(points[name], (joint.axis_first, joint.axis_second), strict=True)
            points[f"{name} axis"] = tuple(point + unit(axis) * LEVER for point, axis in ends)
        tag = "weld" if isinstance(joint, FixedJoint) else "connect"
        for label, (first, second) in points.items():
            site1 = self._site(joint.first, f"{label} first", first, turn)
            site2 = self._site(joint.second, f"{label} second", second)
            options = {"site1": site1, "site2": site2, "solref": QUICK, "solimp": STIFF}
            SubElement(self._section("equality"), tag, name=label, **options)
        return True

    def add_robot(self, robot: Robot) -> None:
        """Add limits and actuators of a robot's file."""
        names = {name: body for body, name in self.joints.items()}
        for name, limits in robot.limits.items():
            coordinate = self._coordinates.get(names.get(name, ""))
            if coordinate is None:
                self.omitted["limits"].append(name)
                continue
            bounded = math.isfinite(limits.lower) and math.isfinite(limits.upper)
            if bounded and coordinate.element.get("range") is None:
                coordinate.element.set("range", _text(limits.lower, limits.upper))
            if math.isfinite(limits.effort):
                coordinate.element.set("actuatorfrcrange", _text(-limits.effort, limits.effort))
            if math.isfinite(limits.velocity):
                self.omitted["limits of velocities"].append(name)
        for name, actuator in robot.actuators.items():
            joint = actuator.joint
            joint = motor_name(joint) if motor_name(joint) in names else joint
            options = {"joint": joint, "gear": _text(actuator.gear, *[0.0] * 5)}
            options |= {"gainprm": _text(actuator.gain), "biastype": "affine"}
            options |= {"biasprm": _text(actuator.bias)}
            for key, limits in (("ctrlrange", actuator.control), ("forcerange", actuator.force)):
                if np.isfinite(limits).all():
                    options[key] = _text(limits)
            SubElement(self._section("actuator"), "general", name=name, **options)

    def start(self, model: PyTree, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Return `qpos` and `qvel` of MuJoCo's model of a file, for a state of the scene."""
        positions, speeds = model.qpos0.copy(), np.zeros(model.nv)
        for name, (position, speed) in self.motion(state).items():
            joint = model.joint(name)
            positions[joint.qposadr[0] :][: len(position)] = position
            speeds[joint.dofadr[0] :][: len(speed)] = speed
        return positions, speeds

    def finish(
        self, location: FileLocation, start: State, timestep: float | None, integrator: str
    ) -> str:
        """Return the file's text, with flanks that have the stiffness and damping of the scene's,
        and a keyframe."""
        mujoco = mujoco_package(location)
        self.option.set("integrator", integrator)
        try:
            model = mujoco.MjModel.from_xml_string(tostring(self.root, encoding="unicode"))
        except ValueError as error:
            reason = " ".join(str(error).split())
            location.refuse(reason, "a scene that MuJoCo compiles", "change the scene")
        fastest = TURN / STEPS_A_PERIOD / LONGEST_STEP
        for element, stiffness, damping in self._flanks:
            name = element.attrib["name"]
            if element.tag == "joint":
                weight = float(model.dof_invweight0[model.joint(name).dofadr[0]])
            else:
                weight = float(model.tendon_invweight0[model.tendon(name).id])
            rates = stiffness * weight, damping(1.0 / weight) * weight
            fastest = max(fastest, math.sqrt(rates[0]))
            element.set("solreflimit", _text(*(-rate for rate in rates)))
            element.set("solimplimit", SOFT)
        step = TURN / STEPS_A_PERIOD / fastest if timestep is None else timestep
        self.option.set("timestep", _text(step))
        key = SubElement(self._section("keyframe"), "key", name="start")
        for attribute, numbers in zip(("qpos", "qvel"), self.start(model, start), strict=True):
            key.set(attribute, _text(numbers))
        if model.nu:
            controls = np.zeros(model.nu)
            for name, control in self.controls.items():
                controls[model.actuator(name).id] = control(jnp.asarray(0.0))
            key.set("ctrl", _text(controls))
        indent(self.root)
        return tostring(self.root, encoding="unicode") + "\n"


WRITERS: Mapping[type, Callable[[MjcfWriter, str, PyTree], bool]] = {
    Backlash: MjcfWriter.backlash,
    PinInSlot: MjcfWriter.pin_in_slot,
    JointFriction: MjcfWriter.friction,
    TorsionalSpring: MjcfWriter.torsional_spring,
    Bushing: MjcfWriter.bushing,
    SpringDamper: MjcfWriter.spring_damper,
    DriveTorque: MjcfWriter.drive_torque,
    Motor: MjcfWriter.motor,
    JointCoupling: MjcfWriter.coupling,
    PrescribedAngle: MjcfWriter.prescribed,
    PrescribedTranslation: MjcfWriter.prescribed,
    SphericalJoint: MjcfWriter.closing,
    FixedJoint: MjcfWriter.closing,
    RevoluteJoint: MjcfWriter.closing,
}
"""What writes an element of the scene that is no joint of the tree, by its class; it returns
whether the element has a counterpart."""


def _damping_ratio(restitution: float) -> float:
    """Return the damping ratio of a spring and dashpot that can't pull and delivers a restitution:
    the inverse of `clamped_restitution`, also above critical damping."""
    from scipy.optimize import brentq

    if restitution >= 1.0:
        return 0.0

    def excess(logarithm: float) -> float:
        ratio = np.exp(logarithm)
        root = abs(np.emath.sqrt(1.0 - ratio**2))
        duration = abs(np.emath.arccos(ratio)) / root if root else 1.0
        return float(-2.0 * ratio * duration - np.log(max(restitution, LEAST_RESTITUTION)))

    return math.exp(brentq(excess, -30.0, 10.0))


def _with_ideal_joints(scene: Scene) -> tuple[Scene, list[str]]:
    """Return the scene with an ideal joint in place of each clearance that has one of the joints of
    a tree, and the names of these."""
    joints, replaced = {}, []
    for name, joint in scene.joints.items():
        centred = joint.centred_joint() if isinstance(joint, AbstractContactJoint) else None
        if centred is not None and unpack(centred).motion_subspace(centred.body_names()[0]):
            joint = centred
            replaced.append(name)
        joints[name] = joint
    with quiet():
        return Scene(scene.bodies, joints, scene.forces, scene.gravity), replaced


def _places(scene: Scene) -> list[Place]:
    """Return the trees of a scene, each parent before its children, siblings in the order of the
    scene: JAX sorts dictionaries by their keys."""
    places = topology(unpack(scene)).places
    depths = {GROUND: 0}
    for body, place in places.items():
        depths[body] = depths[place.parent] + 1
    return [places[body] for body in sorted(scene.bodies, key=depths.__getitem__)]


def mjcf_of(
    scene: Scene | Robot,
    state: State | None,
    location: FileLocation,
    timestep: float | None = None,
    integrator: str = "implicitfast",
) -> tuple[MjcfWriter, str]:
    """Return the text of a file, and its writer; see `save_mjcf`."""
    check_precision(allow_float32=False)
    robot = scene if isinstance(scene, Robot) else None
    expected, remedy = "a Scene or a Robot", "pass that of `load_robot`"
    require_type("scene", scene, Scene | Robot, expected, remedy)  # pyright: ignore
    pose = state if robot is None else robot.state()
    remedy = "pass that in which the bodies of the file are"
    require(pose is not None, "state", state, "given for a scene", remedy)
    integrators = "Euler", "RK4", "implicit", "implicitfast"
    remedy = "give the name of one of MuJoCo's integrators"
    expected = f"one of {listed(integrators)}"
    require(integrator in integrators, "integrator", integrator, expected, remedy)
    if timestep is not None:
        require_positive("timestep", timestep, "give it in s")
    start = pose if state is None else state
    whole = scene.scene if isinstance(scene, Robot) else scene
    check_names(whole, start)
    ideal, replaced = _with_ideal_joints(whole)
    places = _places(ideal) if robot is None else robot.places()
    writer = MjcfWriter(ideal, places, pose)
    if robot is None and not replaced:
        writer.require_in_place(pose)
    if replaced:
        writer.omitted["clearances, replaced by ideal joints,"] += replaced
    if robot is not None:
        writer.add_robot(robot)
    content = writer.finish(location, start, timestep, integrator)
    if writer.omitted:
        parts = (f"{title} of {', '.join(names)}" for title, names in writer.omitted.items())
        caution(f"{location}: not carried over: {'; '.join(parts)}.", NotCarriedOverWarning)
    return writer, content


def save_mjcf(
    scene: Scene | Robot,
    path: FilePath,
    state: State | None = None,
    *,
    timestep: float | None = None,
    integrator: str = "implicitfast",
) -> None:
    """Write a scene or robot as an MJCF file for MuJoCo, with its play by MuJoCo's recipe.

    ```python
    import clearjoint as cj

    elbow = cj.Drive(armature=0.01, play="0.5 deg", stiffness=800.0, damping=0.2)
    robot = cj.load_robot("arm.urdf").with_drive("elbow", elbow)
    cj.save_mjcf(robot, "arm.xml", robot.state({"elbow": 0.3}))
    print(cj.compare_with_mujoco(robot, robot.state({"elbow": 0.3}), end_time=0.5))
    ```

    The file has the bodies, their tree of hinges, sliders, balls and fixed joints, and free bodies;
    armatures, dampers, springs and dry friction of hinges and sliders, and `SpringDamper`. Joints
    that close loops, `JointCoupling` and constant `PrescribedAngle` are equality constraints, which
    are soft in MuJoCo. A `DriveTorque` or `Motor` is an actuator, whose control the keyframe
    "start" has at time zero; the keyframe also has the `state`. Joints have their names and
    positions.

    MuJoCo's recipe for backlash is two hinges in series, of which the second has a small range and
    a stiff limit. The flanks of a `Backlash`, or of a `PinInSlot` along a slider, become such a
    limit, of the hinge between the two bodies, or of a fixed tendon if, as with `Robot.with_drive`,
    rotor and link are both on the link's first body. The limit has the stiffness of the flanks and
    the damping of a `SpringDashpot`; with other laws it is linear, with the stored energy at a
    tenth of the play and the restitution of an impact in the pose of the file. For this, it has the
    smallest impedance that MuJoCo accepts, 1e-4. With MuJoCo's default, the limit would set an
    acceleration, whatever the load: it would give way by millimetres in an impact, and by nothing
    under a static load. After changes of masses, write the file again. Without play, `load_robot`
    reads a robot from its file as it was.

    Elements without counterpart are left out: `ClearanceJoint` and `BallInSocket` become ideal
    joints, and bodies on joints of other types are free. Limits of a robot's joints, without effect
    in a scene unless they are stops, act in MuJoCo.

    **Arguments:**

    - `scene`: a `Scene`, or a `Robot`.
    - `path`: of the file; an existing one is overwritten.
    - `state`: of the keyframe. A scene's file describes the bodies in this pose, a robot's with all
      joints at zero; that is the default.
    - `timestep`: s; by default a twentieth of the period of the stiffest flank in the pose of the
      file, or 2 ms.
    - `integrator`: one of MuJoCo's: "Euler", "RK4", "implicit" or "implicitfast".

    **Raises:** `ValueError` for a state that the ideal joints do not allow, and for a scene that
    MuJoCo can't compile. `ImportError` without the extra ``mujoco``. **Warns:**
    `NotCarriedOverWarning` lists what the file lacks.
    """
    path = Path(path)
    _, content = mjcf_of(scene, state, FileLocation(str(path)), timestep, integrator)
    path.write_text(content, encoding="utf-8")
