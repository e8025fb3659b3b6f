"""Write scenes and robots as MJCF files, with play by MuJoCo's recipe.

A body's frame in the file is that of the scene: its origin is the centre of mass. Positions of
hinges and sliders are those of the scene's joints: the attribute `ref` has those in the pose that
the file describes.

Flanks are limits of a hinge or, between bodies that are not parent and child, of a fixed tendon,
whose length is a sum of hinges' angles. With the limit, MuJoCo accelerates the joint by

    (1 - d) a - b v - k r,

where d is the limit's impedance, a the acceleration without the limit, r the penetration and v its
rate; the numbers of `solreflimit` are -k and -b. An impedance near one, as by default, fixes the
acceleration: a load hardly deflects the limit. With an impedance near zero, the limit is a spring
and damper, whose force does not depend on the load: its stiffness is k over the inverse inertia
that MuJoCo computes when it compiles the file (`dof_invweight0`, `tendon_invweight0`), in any pose.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import NamedTuple, TypeAlias
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from .._dynamics.constraint_report import check_names
from .._dynamics.joint_coordinates import trees
from .._dynamics.joint_coordinates.coordinates import motions_of, orientations_of, written_out
from .._dynamics.journals import centring_joints, with_ideal
from .._fields.checks import require, require_positive
from .._math.rotations import composed, conjugate, rotation_matrix, unit
from .._math.smoothing import TURN, wrapped
from .._math.vectors import Scalar, Vector, pack, unpack
from .._model.bodies import GROUND, State
from .._model.clearance_joints.backlash import Backlash
from .._model.clearance_joints.between_walls import PinInSlot
from .._model.contact.dashpots import AbstractDashpotLaw, clamped_restitution
from .._model.contact.laws import AbstractContactLaw, Gap
from .._model.drives import functions_of_time
from .._model.drives.drivers import DriveTorque, Motor, PrescribedAngle, PrescribedTranslation
from .._model.forces import Bushing, SpringDamper, TorsionalSpring
from .._model.joints.couplings import JointCoupling
from .._model.joints.ideal import FixedJoint, HingeOrSlider, RevoluteJoint, SphericalJoint
from .._model.joints.joint_friction import JointFriction
from .._model.joints.motion_subspaces import Ball, Hinge, Slider, Weld
from .._model.scene import Scene
from .._simulation.run.run_checks import check_precision
from .._simulation.run.wall_impact import free_impact
from .documents import FileLocation, listed
from .files import FilePath
from .mjcf import Model, mujoco_package
from .robot import Robot, variables_of
from .robots import warn_of_omitted

SOFT, STIFF = "0.0001 0.0001 0.001 0.5 1", "0.9999 0.9999 0.001 0.5 1"
"""`solimp` with the smallest impedance, for flanks, and with the largest, for constraints and dry
friction, which would creep."""
QUICK = "0.0001 1"
"""`solref` of equality constraints and of dry friction; MuJoCo takes at least two time steps, s."""
LARGEST_PENETRATION = 0.1
"""Penetration, as a fraction of the play, at which a limit's spring stores the law's energy."""
STEPS_A_PERIOD, LONGEST_STEP = 20.0, 2e-3
"""Default number of time steps in the shortest period of a flank or spring; longest step, s."""
PARALLEL, IN_PLACE = 1e-9, 1e-6
"""Largest deviation of the cosine of parallel axes from one, and of bodies from their joints, m."""
HARD = {"solref": QUICK, "solimp": STIFF}
"""Attributes of equality constraints."""
CRITICAL = 1.0 - 1e-9
"""Largest damping ratio of a limit, at which the restitution is 0.14."""
LEAST_INERTIA = 2e-15
"""Least mass, kg, and moment of inertia, kg m^2, of a body that MuJoCo accepts."""
OF_PRESSED = "friction by the force of another element"
LARGEST_DEGREE = 4
"""Largest degree of a polynomial that couples joints of MJCF files."""
LEVER = 0.1
"""Distance, m, between the two points by which the axis of a closing hinge is written."""
FREE, BALL, HINGE, SLIDE = "free", "ball", "hinge", "slide"
Control: TypeAlias = Callable[[jax.Array], jax.Array]


class FileJoint(NamedTuple):
    """A joint or fixed tendon of the file, by its XML `element`, and how the scene's joint that it
    stands for, or a joint or force of the scene that acts on it, is related to it.

    - `axis`: (3,) of the file's joint or of what acts on it, in global axes in the file's pose.
    - `position`: of the file's joint or tendon in this pose, rad or m.
    - `sign`: 1 if the position grows with that of the scene's joint or of what acts, else -1.
    - `start`: coordinate of the scene's joint in this pose; ``None`` for a tendon or free joint.
    """

    element: Element
    axis: np.ndarray
    position: float = 0.0
    sign: float = 1.0
    start: PyTree = None

    @property
    def kind(self) -> str:
        return self.element.get("type", FREE)

    @property
    def name(self) -> str:
        return self.element.attrib["name"]


class NoCounterpartError(Exception):
    """An element of the scene can't be written to MJCF files."""


class Flanks(NamedTuple):
    """A limit of a joint or tendon for the scene's element `name`: `play`, rad or m; `stiffness`,
    N m/rad or N/m; and `damping`, N m s/rad or N s/m, as a function of the inertia at the joint or
    tendon, kg m^2 or kg."""

    name: str
    play: float
    stiffness: float
    damping: Callable[[float], float]


def _child(parent: Element, tag: str, **attributes: PyTree) -> Element:
    """Add an XML element and return it; attributes that are ``None`` are left out."""
    return SubElement(parent, tag, {k: _text(v) for k, v in attributes.items() if v is not None})


def _text(numbers: PyTree) -> str:
    if isinstance(numbers, str):
        return numbers
    parts = np.concatenate([np.ravel(np.asarray(x, float)) for x in jax.tree.leaves(pack(numbers))])
    return " ".join(repr(part + 0.0) for part in parts.tolist())  # no negative zeros


def _array(vector: PyTree) -> np.ndarray:
    return np.asarray(pack(vector), dtype=float)


class MjcfWriter:
    """The MJCF file of a scene, whose bodies are in a `pose`. `places`: the place of each body in
    the tree of joints, parents first.

    - `joints`: the file's joints by the body that each of them carries.
    - `controls`: for each actuator that is a force of the scene, its control as a function of time.
    - `omitted`: names of elements of the scene that have no counterpart, by title in messages.
    """

    def __init__(self, scene: Scene, places: Iterable[trees.Place], pose: State):
        self.joints: dict[str, FileJoint] = {}
        self.controls: dict[str, Control] = {}
        self.omitted: dict[str, list[str]] = defaultdict(list)
        self.root = Element("mujoco", model="clearjoint")
        _child(self.root, "compiler", angle="radian", inertiafromgeom="false")
        gravity = np.zeros(3) if scene.gravity is None else scene.gravity
        self._option = _child(self.root, "option", gravity=gravity)
        self._bodies = {GROUND: _child(self.root, "worldbody")}
        self._flanks: dict[Element, Flanks] = {}
        # Tendons by the bodies that their joints carry, each with the coefficient of its joint.
        self._tendons: dict[tuple[tuple[str, float], ...], FileJoint] = {}
        self._scene = unpack(jax.tree.map(np.asarray, scene))
        self._branches = {place.body: self._branch(place) for place in places}
        # The motions and orientations in which the joints of the tree put the bodies. `walk` is the
        # list of branches in the form that `motions_of` and `orientations_of` take.
        variables, walk = self._variables(pose), written_out(self._branches.values())
        self._motions = motions_of(walk, variables)
        self._turns = orientations_of(walk, variables)
        for body, variable in variables.items():
            self._add_body(body, variable)
        in_tree = {b.joint for b in self._branches.values() if isinstance(b, trees.JointedBranch)}
        # In the order of the scene: JAX has sorted the names in the dictionaries of `_scene`.
        elements = self._scene.joints | self._scene.forces
        for name in (*scene.joints, *scene.forces):
            if name not in in_tree:
                try:
                    self._add(name, elements[name])
                except NoCounterpartError:
                    self.omitted[type(elements[name]).__name__].append(name)

    def _branch(self, place: trees.Place) -> trees.TreeBranch:
        if place.joint is not None:
            subspace = self._scene.joints[place.joint].motion_subspace(place.parent)
            if isinstance(subspace, Hinge | Slider | Ball | Weld):
                return trees.JointedBranch(place.body, place.parent, place.joint, subspace)
        return trees.FreeBranch(place.body, None)

    def _variables(self, state: State) -> dict[str, PyTree]:
        return variables_of([*self._branches.values()], jax.tree.map(np.asarray, state))

    def motion(self, state: State) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Return positions and speeds of the file's joints, by name, for a state of the scene or,
        with a first axis (N,), for N states: 7 and 6 numbers of a free joint, 4 and 3 of a ball,
        and one of other joints, as in MuJoCo."""
        numbers = {}
        for body, variable in self._variables(state).items():
            if (joint := self.joints.get(body)) is None:  # fixed to its parent
                continue
            if joint.kind == FREE:
                place = variable.position, variable.orientation
                parts = place, (variable.velocity, variable.spin)
            elif joint.kind == BALL:  # MuJoCo measures a ball's rotation from the pose of the file
                parts = composed(conjugate(joint.start), variable.position), variable.speeds
            else:
                (speed,) = variable.speeds
                # The pose of the file has the file's joint at `position`, the scene's at `start`.
                position = joint.position + joint.sign * (variable.position - joint.start)
                if joint.kind == HINGE:
                    # The scene knows angles up to whole turns. The file's are near the middle of
                    # the hinge's range, or else near the angle in the pose of the file.
                    middle = np.mean(_range(joint.element) or joint.position)
                    position = position - TURN * np.round((position - middle) / TURN)
                    # In a row of states, the angle continues over whole turns.
                    position = np.unwrap(position) if np.ndim(position) else position
                parts = position, joint.sign * speed
            # The numbers of positions, and those of speeds, side by side along a last axis.
            rows = (np.broadcast_arrays(*jax.tree.leaves(part)) for part in parts)
            numbers[joint.name] = tuple(np.stack(row, axis=-1) for row in rows)
        return numbers

    def require_in_place(self, state: State) -> None:
        """Raise a `ValueError` for bodies that are not where the joints of the tree allow them."""
        for name in self._branches:
            off = np.asarray(state.bodies[name].position) - _array(self._motions[name].position)
            joint = f"on the joint of {name!r}, within {IN_PLACE} m"
            remedy = "correct the state with `assemble`"
            require(np.abs(off).max() < IN_PLACE, "state", off, joint, remedy)

    def _add_body(self, name: str, variable: PyTree) -> None:
        # `variable`: the body's `JointState` or, for a free root, its `BodyState`.
        branch, body = self._branches[name], self._scene.bodies[name]
        # In the file, a body's position and orientation are in the axes of its parent.
        parent = self._motions[branch.parent]
        place = parent.components(self._motions[name].position - parent.position)
        relative = composed(conjugate(self._turns[branch.parent]), self._turns[name])
        element = _child(self._bodies[branch.parent], "body", name=name, pos=place, quat=relative)
        self._bodies[name], least = element, 0.0
        if isinstance(branch, trees.FreeBranch):
            free = _child(element, "freejoint", name=f"{name} free")
            self.joints[name] = FileJoint(free, axis=np.zeros(3))  # a free joint has no axis
        elif not isinstance(branch.motion_subspace, Weld):
            self.joints[name] = joint = self._joint(element, branch, variable.position)
            # MuJoCo refuses the negligible mass and inertia of the rotor of a drive train.
            least = 0.0 if joint.element.get("armature") is None else LEAST_INERTIA
        inertia = _array(body.inertia)
        if inertia.ndim == 2:
            # MuJoCo's order: xx, yy, zz, xy, xz, yz.
            moments = {"fullinertia": (np.diag(inertia), inertia[0, 1:], inertia[1, 2])}
        else:
            moments = {"diaginertia": np.maximum(inertia, least)}
        _child(element, "inertial", pos="0 0 0", mass=np.maximum(body.mass, least), **moments)

    def _joint(
        self, element: Element, branch: trees.JointedBranch, coordinate: PyTree
    ) -> FileJoint:
        subspace, joint = branch.motion_subspace, self._scene.joints[branch.joint]
        common = {"name": branch.joint, "pos": subspace.point_child}
        if isinstance(subspace, Ball):
            ball = _child(element, "joint", type=BALL, **common)
            return FileJoint(ball, np.zeros(3), start=coordinate)
        assert isinstance(subspace, Hinge | Slider)
        # A joint coordinate, and a position in the file, are those of the child relative to the
        # parent; a joint's position in the scene is that of its second body relative to the first,
        # which may be the child. With the opposite axis, the file then has the scene's position.
        sign = 1.0 if joint.body_names()[0] == branch.parent else -1.0
        axis, position, armature = subspace.axis * sign, sign * float(coordinate), None
        # The position of a joint of the scene may have another zero than its coordinate.
        if isinstance(joint, HingeOrSlider):
            position, armature = float(joint.position(self._motions).value), joint.armature
        common |= {"axis": axis, "ref": position, "armature": armature}
        common["type"] = HINGE if isinstance(subspace, Hinge) else SLIDE
        along = _array(self._motions[branch.body].direction(axis))
        return FileJoint(_child(element, "joint", **common), along, position, sign, coordinate)

    def _section(self, name: str) -> Element:
        section = self.root.find(name)
        return _child(self.root, name) if section is None else section

    def _add(self, name: str, element: PyTree) -> None:
        kind = type(element)
        if kind in ALONG:
            direction, axis, write = ALONG[kind]
            # A class whose `axis` is None, such as `Bushing`, acts along any slider.
            on = self._between(name, direction, element, getattr(element, axis or "", None))
            write(self, name, element, on)
        elif kind in OTHERS:
            OTHERS[kind](self, name, element)
        else:
            raise NoCounterpartError

    def _between(self, name: str, kind: str, element: PyTree, axis: Vector | None) -> FileJoint:
        """Return the joint or tendon whose position is that of an element's second body relative to
        the first, about or along an `axis`, (3,) in the first body's axes; ``None`` stands for the
        axis of the first joint between the bodies. Raise a `NoCounterpartError` unless all joints
        between them are of the `kind`, `HINGE` or `SLIDE`, and have this axis. `name`: of the
        tendon, if one is added."""
        first, second = element.pair()
        # How the element's position changes with that of a body's joint: by 1 if the joint carries
        # only the second body, by -1 if only the first, and not at all if both or none.
        sides: dict[str, float] = defaultdict(float)
        for body, side in ((first, -1.0), (second, 1.0)):
            while body != GROUND:
                sides[body] += side
                body = self._branches[body].parent
        # The bodies whose joints are between `first` and `second`. Bodies that are fixed to their
        # parents have no joint.
        between = [b for b in self._branches if sides.get(b) and b in self.joints]
        if not between or any(self.joints[body].kind != kind for body in between):
            raise NoCounterpartError
        common_axis = self.joints[between[0]].axis
        if axis is not None:
            common_axis = _array(self._motions[first].direction(unit(axis)))
        cosines = [float(self.joints[body].axis @ common_axis) for body in between]
        if min(map(abs, cosines)) < 1.0 - PARALLEL:
            raise NoCounterpartError
        # A joint with the opposite axis counts with the opposite sign.
        signs = [sides[b] * float(np.sign(c)) for b, c in zip(between, cosines, strict=True)]
        if len(between) == 1:
            return self.joints[between[0]]._replace(sign=signs[0], axis=common_axis)
        # Elements with opposite signs share a tendon, in which the first joint has the sign 1.
        key = tuple((body, signs[0] * sign) for body, sign in zip(between, signs, strict=True))
        if key not in self._tendons:
            tendon = _child(self._section("tendon"), "fixed", name=name)
            for body, sign in key:
                _child(tendon, "joint", joint=self.joints[body].name, coef=sign)
            position = sum(sign * self.joints[body].position for body, sign in key)
            self._tendons[key] = FileJoint(tendon, common_axis, position)
        return self._tendons[key]._replace(sign=signs[0], axis=common_axis)

    def backlash(self, name: str, joint: Backlash, on: FileJoint) -> None:
        offset = joint.centred_rows(self._motions)["angle"].value
        self._limit(name, on, joint.law, offset, joint.play, joint.radius)

    def ends_of_slot(self, name: str, joint: PinInSlot, on: FileJoint) -> None:
        """Limit the slider `on` by the ends of the slot. The slider has no play across the slot,
        unlike the pin of the scene."""
        if joint.travel is None:  # a slot without ends
            raise NoCounterpartError
        slot, pin = (self._motions[body] for body in joint.pair())
        apart = pin.point(joint.pin_point) - slot.point(joint.slot_point)
        offset = apart.dot(slot.direction(unit(joint.slot_axis)))
        self._limit(name, on, joint.law, offset, joint.travel, 1.0)

    def _limit(
        self,
        name: str,
        on: FileJoint,
        law: AbstractContactLaw,
        offset: Scalar,
        play: Scalar,
        lever: Scalar,
    ) -> None:
        """Limit a joint or tendon by the two flanks of a play, whose contact has the given law.

        **Arguments:** `name`: of the scene's element. `on`: the joint or tendon. `offset`:
        displacement of the scene's element from the middle of the play in the pose of the file, rad
        or m; `play`: rad or m; `lever`: the law's penetration over the displacement, m/rad or 1.
        """
        offset, play, lever = float(offset), float(play), float(lever)
        if (other := self._flanks.get(on.element)) is not None:
            # A joint of MuJoCo has one range. Of two limits, such as a play and the stops of the
            # joint, only the narrower one is ever reached.
            self.omitted["wider limits"].append(name if other.play < play else other.name)
            if other.play < play:
                return
        middle = on.position - on.sign * offset  # position in the file at the middle of the play
        on.element.set("range", _text((middle - 0.5 * play, middle + 0.5 * play)))
        # MuJoCo's limits are linear springs. The spring stores the same energy as the law at
        # `depth`; for a nonlinear law, the stiffness from half the depth differs.
        depth = LARGEST_PENETRATION * play * lever
        stiffness, stiffness_from_half = (
            2.0 * float(law.stored_energy(Gap(x, 0.0))) / x**2 for x in (depth, 0.5 * depth)
        )
        if abs(stiffness - stiffness_from_half) > 1e-9 * stiffness:
            self.omitted["nonlinear stiffness"].append(name)

        # A function, since MuJoCo computes the inertia at the joint from the complete file. Except
        # for a linear dashpot, the damping is that which gives the law's coefficient of
        # restitution, if need be at the impact speed for which the spring reaches `depth`.
        def damping(inertia: float) -> float:
            mass = inertia / lever**2  # kg, at the contact
            if isinstance(law, AbstractDashpotLaw) and law.damping_exponent == 0.0:
                return float(law.damping(Gap(depth, 0.0))) * lever**2
            if hasattr(law, "delivered_restitution"):
                restitution = float(law.delivered_restitution())  # pyright: ignore
            else:
                speed = depth * math.sqrt(stiffness / mass)
                restitution = free_impact(law, mass, speed).restitution
            return 2.0 * _damping_ratio(restitution) * math.sqrt(stiffness * mass) * lever**2

        # A penetration is the displacement times the lever, and a torque the force times the lever.
        self._flanks[on.element] = Flanks(name, play, stiffness * lever**2, damping)

    def spring(self, name: str, force: TorsionalSpring, on: FileJoint) -> None:
        twist = wrapped(force.relative_angle(self._motions).value - force.rest_angle, TURN)
        self._resist(on, float(force.stiffness), float(twist), damping=float(force.damping))

    def bushing(self, name: str, force: Bushing, on: FileJoint) -> None:
        """Add the spring and damper of a bushing to a slider, whose motion strains the bushing."""
        first, second = (self._motions[body] for body in force.pair())
        # The bushing's own axes may be oblique to the slider's axis.
        axes = _array(rotation_matrix(composed(self._turns[force.first], force.orientation_first)))
        # Components of the slider's axis along the bushing's axes: a displacement of 1 m along the
        # slider strains each spring of the bushing by its component, m, and the energies add up.
        along, stiffnesses = on.axis @ axes, _array(force.stiffness)
        stiffness = float(along**2 @ stiffnesses)
        damping = float(along**2 @ _array(force.damping))
        apart = _array(second.point(force.point_second) - first.point(force.point_first))
        # If the bushing's axes are oblique, a distance between the points across the slider's axis
        # also gives a force along this axis.
        stretch = float(along * stiffnesses @ (apart @ axes)) / stiffness if stiffness else 0.0
        self._resist(on, stiffness, stretch, damping=damping)

    def friction(self, name: str, joint: JointFriction) -> None:
        if joint.axis is None:  # friction of a ball
            raise NoCounterpartError
        kind, lever = (SLIDE, 1.0) if joint.radius is None else (HINGE, float(joint.radius))
        on = self._between(name, kind, joint, joint.axis)
        law, load = joint.friction, float(joint.load)
        # MuJoCo's dry friction does not depend on the speed: that at a slip of 1 m/s is taken. With
        # bristles, `force` leaves out the law's viscous part, which is added to the damping below.
        sliding = -float(law.force(load, Vector(1.0, 0.0, 0.0)).x)
        if getattr(law, "breakaway", 0.0) > getattr(law, "kinetic", math.inf):
            self.omitted["friction at rest above that in sliding"].append(name)
        if joint.pressed_by is not None:
            self.omitted[OF_PRESSED].append(name)
        viscosity = load * float(getattr(law, "viscosity", 0.0))
        viscosity += 0.0 if joint.viscosity is None else float(joint.viscosity)
        on.element.attrib |= {"solimpfriction": STIFF, "solreffriction": QUICK}
        self._resist(on, frictionloss=sliding * lever, damping=viscosity * lever**2)

    def _resist(
        self, on: FileJoint, stiffness: float = 0.0, stretch: float = 0.0, **others: float
    ) -> None:
        """Add a spring to a joint or tendon, with a `stiffness`, N m/rad or N/m, and stretched by
        `stretch`, rad or m, in the pose of the file; add the numbers `others` to the attributes of
        the same names, such as `damping`."""
        # A tendon has two rest lengths, between which its spring is slack. Here they are equal.
        rest, count = ("springref", 1) if on.element.tag == "joint" else ("springlength", 2)
        earlier = float(on.element.get("stiffness", 0.0))
        if stiffness:
            # The forces of this and an earlier spring add up: the common rest position is the mean
            # of both rest positions, weighted by stiffness.
            weighted = stiffness * (on.position - on.sign * stretch)
            weighted += earlier * float(on.element.get(rest, "0").split()[0])
            on.element.set(rest, _text(np.full(count, weighted / (earlier + stiffness))))
        for key, value in {"stiffness": stiffness, **others}.items():
            if value:
                on.element.set(key, _text(float(on.element.get(key, 0.0)) + value))

    def spring_damper(self, name: str, force: SpringDamper) -> None:
        length = force.free_length, force.free_length
        numbers = {"stiffness": force.stiffness, "damping": force.damping, "springlength": length}
        tendon = _child(self._section("tendon"), "spatial", name=name, **numbers)
        for site in self._sites(name, force, force.point_first, force.point_second):
            _child(tendon, "site", site=site)

    def _sites(
        self, name: str, pair: PyTree, first: PyTree, second: PyTree, turn: PyTree = trees.UPRIGHT
    ) -> list[str]:
        """Add the sites "`name` first" and "`name` second", and return their names. They are at the
        points `first` and `second`, (3,) m in body axes, of the two bodies of `pair`, a joint or a
        force. The first site has the orientation `turn` in its body."""
        ends = ((pair.first, "first", first, turn), (pair.second, "second", second, trees.UPRIGHT))
        for body, end, point, orientation in ends:
            _child(self._bodies[body], "site", name=f"{name} {end}", pos=point, quat=orientation)
        return [f"{name} {end}" for _, end, *_ in ends]

    def torque(self, name: str, force: DriveTorque, on: FileJoint) -> None:
        self._actuate(name, on, lambda t: jnp.asarray(functions_of_time.value_at(force.torque, t)))

    def motor(self, name: str, force: Motor, on: FileJoint) -> None:
        """Add a servo, whose control is the target plus the target's rate times damping / gain."""
        gain, damping = float(force.proportional), float(force.derivative)

        def control(t: jax.Array) -> jax.Array:
            value, rate = map(jnp.asarray, functions_of_time.value_and_rate(force.target, t))
            # Without a gain, the actuator's factor of the control is 1 (`gainprm`).
            return value + damping / gain * rate if gain else damping * rate

        # The length of the actuator is the angle less `zero`.
        zero = float(force.relative_angle(self._motions).value) - on.sign * on.position
        limit = force.torque_limit
        bias, limits = (-gain * zero, -gain, -damping), None if limit is None else (-limit, limit)
        numbers = {"gainprm": gain or 1.0, "biasprm": bias, "forcerange": limits}
        self._actuate(name, on, control, biastype="affine", **numbers)

    def _actuate(self, name: str, on: FileJoint, control: Control, **options: PyTree) -> None:
        end = {"joint" if on.element.tag == "joint" else "tendon": on.name}
        _child(self._section("actuator"), "general", name=name, gear=on.sign, **end, **options)
        self.controls[name] = control

    def prescribed(self, name: str, drive: PyTree, on: FileJoint) -> None:
        function = functions_of_time.as_function_of_time(drive.function)
        if not isinstance(function, functions_of_time.Polynomial) or len(function.coefficients) > 1:
            raise NoCounterpartError  # only a constant position has a counterpart
        # In the pose of the file, the row's value is the position less the prescribed one.
        (row,) = drive.rows(self._motions, 0.0).values()
        self._equate(name, [on], np.array([-on.sign * float(row.value)]))

    def coupling(self, name: str, joint: JointCoupling) -> None:
        ends, function = [], functions_of_time.as_function_of_time(joint.function)
        if not isinstance(function, functions_of_time.Polynomial):
            raise NoCounterpartError
        for end in (joint.follower, joint.leader):
            is_hinge = isinstance(end, RevoluteJoint)
            kind, axis = (HINGE, end.axis_first) if is_hinge else (SLIDE, end.axis)
            position = float(end.position(self._motions).value)
            ends.append((self._between(name, kind, end, axis), position))
        (follower, y), (leader, x) = ends
        # In the scene, the follower's position y is a polynomial of the leader's position x. In
        # MuJoCo, the follower's displacement from the pose of the file is one of the leader's. If
        # `sign` is -1, a position in the file falls where that in the scene rises.
        polynomial = np.polynomial.Polynomial(np.asarray(function.coefficients))
        shifted = (polynomial(np.polynomial.Polynomial([x, leader.sign])) - y).trim().coef
        if isinstance(joint.follower, RevoluteJoint):  # whose angle is known up to whole turns
            shifted[0] = wrapped(shifted[0], TURN)
        self._equate(name, [follower, leader], follower.sign * shifted)

    def _equate(self, name: str, ends: list[FileJoint], coefficients: np.ndarray) -> None:
        """Couple two `ends`, joints or tendons: the first one's displacement from the pose of the
        file is a polynomial of the second one's, with `coefficients` from the constant on. If there
        is only one end, hold it at the displacement `coefficients[0]`."""
        # MuJoCo couples two joints or two tendons, not one of each.
        tags = {end.element.tag for end in ends}
        if len(tags) > 1 or len(coefficients) > LARGEST_DEGREE + 1:
            raise NoCounterpartError
        tag = "joint" if tags == {"joint"} else "tendon"
        names = {f"{tag}{k}": end.name for k, end in enumerate(ends, 1)}
        padded = np.pad(coefficients, (0, LARGEST_DEGREE + 1 - len(coefficients)))
        _child(self._section("equality"), tag, name=name, **names, polycoef=padded, **HARD)

    def closing(self, name: str, joint: PyTree) -> None:
        """Add a joint that closes a loop: a ball, a weld, or for a hinge two balls on its axis."""
        turn = joint.orientation if isinstance(joint, FixedJoint) else trees.UPRIGHT
        tag = "weld" if isinstance(joint, FixedJoint) else "connect"
        points = {name: (joint.point_first, joint.point_second)}
        if isinstance(joint, RevoluteJoint):
            axes = zip(points[name], (joint.axis_first, joint.axis_second), strict=True)
            points[f"{name} axis"] = tuple(point + unit(axis) * LEVER for point, axis in axes)
        for label, (first, second) in points.items():
            site1, site2 = self._sites(label, joint, first, second, turn)
            ends = {"site1": site1, "site2": site2}
            _child(self._section("equality"), tag, name=label, **ends, **HARD)

    def add_robot(self, robot: Robot) -> None:
        joints = {joint.name: joint.element for joint in self.joints.values()}
        for name, limits in robot.limits.items():
            if name not in joints:  # the file has no such joint
                self.omitted["limits"].append(name)
                continue
            # A range that flanks or stops of the scene have set stays, since it is not wider.
            ends, of_flanks = (limits.lower, limits.upper), _range(joints[name])
            efforts = -limits.effort, limits.effort
            ranges = {"actuatorfrcrange": efforts, "range": of_flanks or ends}
            joints[name].attrib |= {key: _text(pair) for key, pair in _finite(ranges).items()}
            if of_flanks and np.isfinite(ends).all() and not np.allclose(ends, of_flanks):
                self.omitted["wider limits"].append(name)
            if math.isfinite(limits.velocity):
                self.omitted["limits of velocities"].append(name)
        for name, actuator in robot.actuators.items():
            # With play or compliance, the actuator acts on the motor, not on the link.
            joint = robot._motors().get(actuator.joint, actuator.joint)
            numbers = {"gear": actuator.gear, "gainprm": actuator.gain, "biasprm": actuator.bias}
            numbers |= _finite({"ctrlrange": actuator.control, "forcerange": actuator.force})
            options = {"biastype": "affine", "name": name, "joint": joint, **numbers}
            _child(self._section("actuator"), "general", **options)

    def start(self, model: Model, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Return `qpos`, (nq,), and `qvel`, (nv,), of MuJoCo's model, for a state of the scene."""
        positions, speeds = model.qpos0.copy(), np.zeros(model.nv)
        for name, (position, speed) in self.motion(state).items():
            joint = model.joint(name)
            positions[joint.qposadr[0] :][: len(position)] = position
            speeds[joint.dofadr[0] :][: len(speed)] = speed
        return positions, speeds

    def finish(
        self, location: FileLocation, start: State, timestep: float | None, integrator: str
    ) -> str:
        """Return the file's text, with the flanks' stiffness and damping and with the keyframe
        `start`. `location`: for errors. `timestep`: s; ``None`` for the default of `save_mjcf`."""
        mujoco = mujoco_package(location)
        # MuJoCo first compiles the file without the numbers of limits, since these numbers depend
        # on inertias that MuJoCo computes.
        try:
            model = mujoco.MjModel.from_xml_string(tostring(self.root, encoding="unicode"))
        except ValueError as error:
            reason = " ".join(str(error).split())
            location.refuse(reason, "a scene that MuJoCo compiles", "change the scene")

        def inverse_inertia(element: Element) -> float:  # by MuJoCo, at a joint or tendon
            name = element.attrib["name"]
            if element.tag == "joint":
                return float(model.dof_invweight0[model.joint(name).dofadr[0]])
            return float(model.tendon_invweight0[model.tendon(name).id])

        # Squares of the angular frequencies, rad/s, that time steps must resolve; the first one
        # gives the longest step.
        squares = [(TURN / STEPS_A_PERIOD / LONGEST_STEP) ** 2]
        for element, flanks in self._flanks.items():
            inverse = inverse_inertia(element)
            # The coefficients -k and -b, which the docstring of this module explains.
            numbers = -flanks.stiffness * inverse, -flanks.damping(1.0 / inverse) * inverse
            element.attrib |= {"solreflimit": _text(numbers), "solimplimit": SOFT}
            squares.append(flanks.stiffness * inverse)
        for spring in (e for e in self.root.iter() if "stiffness" in e.attrib):
            squares.append(float(spring.attrib["stiffness"]) * inverse_inertia(spring))
        step = timestep or TURN / STEPS_A_PERIOD / math.sqrt(max(squares))
        self._option.attrib |= {"integrator": integrator, "timestep": _text(step)}
        positions, speeds = self.start(model, start)
        controls = np.zeros(model.nu)
        for name, control in self.controls.items():
            controls[model.actuator(name).id] = control(jnp.asarray(0.0))
        numbers = {"qpos": positions, "qvel": speeds, "ctrl": controls if model.nu else None}
        _child(self._section("keyframe"), "key", name="start", **numbers)
        indent(self.root)
        return tostring(self.root, encoding="unicode") + "\n"


ALONG: Mapping[type, tuple[str, str | None, Callable[..., None]]] = {
    Backlash: (HINGE, "axis_first", MjcfWriter.backlash),
    PinInSlot: (SLIDE, "slot_axis", MjcfWriter.ends_of_slot),
    TorsionalSpring: (HINGE, "axis", MjcfWriter.spring),
    Bushing: (SLIDE, None, MjcfWriter.bushing),
    DriveTorque: (HINGE, "axis", MjcfWriter.torque),
    Motor: (HINGE, "axis", MjcfWriter.motor),
    PrescribedAngle: (HINGE, "axis", MjcfWriter.prescribed),
    PrescribedTranslation: (SLIDE, "axis", MjcfWriter.prescribed),
}
"""For each class of elements about or along an axis of their first body: the kind of the file's
joints on which they act, the name of the axis, and the method that adds them to the file."""
OTHERS: Mapping[type, Callable[..., None]] = {
    JointFriction: MjcfWriter.friction,
    SpringDamper: MjcfWriter.spring_damper,
    JointCoupling: MjcfWriter.coupling,
    SphericalJoint: MjcfWriter.closing,
    FixedJoint: MjcfWriter.closing,
    RevoluteJoint: MjcfWriter.closing,
}


def _range(element: Element) -> list[float]:
    return [*map(float, element.get("range", "").split())]


def _finite(ranges: Mapping[str, tuple[float, float]]) -> dict[str, PyTree]:
    return {key: pair for key, pair in ranges.items() if np.isfinite(pair).all()}


def _damping_ratio(restitution: float) -> float:
    from scipy.optimize import brentq

    restitution = np.clip(restitution, float(clamped_restitution(CRITICAL)), 1.0)
    return brentq(lambda ratio: float(clamped_restitution(ratio)) - restitution, 0.0, CRITICAL)  # pyright: ignore


def _with_ideal_joints(scene: Scene) -> tuple[Scene, list[str]]:
    """Return the scene with ideal joints in place of clearance joints, and the names of the joints
    replaced: those whose ideal joint has a motion subspace, which a tree of joints needs."""
    centring = centring_joints(scene, scene.contact_joints()).items()
    ideal = {n: j for n, j in centring if unpack(j).motion_subspace(j.body_names()[0])}
    return with_ideal(scene, ideal), [*ideal]


def _places(scene: Scene) -> list[trees.Place]:
    """Return the places of a scene's bodies in trees of joints, parents first. Bodies of the same
    depth are in the order of the scene, although `unpack` has sorted them by name."""
    places = trees.topology(unpack(scene)).places
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
    check_precision(allow_float32=False)
    expected, remedy = "a Scene or a Robot", "pass that of `load_robot`"
    require(isinstance(scene, Scene | Robot), "scene", scene, expected, remedy)
    robot, mechanism = (scene, scene.scene) if isinstance(scene, Robot) else (None, scene)
    # The file describes the bodies in `pose`; its keyframe is the state `start`.
    pose = state if robot is None else robot.state()
    remedy = "pass that in which the bodies of the file are"
    require(pose is not None, "state", state, "given for a scene", remedy)
    assert pose is not None
    integrators = "Euler", "RK4", "implicit", "implicitfast"
    remedy = "give the name of one of MuJoCo's integrators"
    expected = f"one of {listed(integrators)}"
    require(integrator in integrators, "integrator", integrator, expected, remedy)
    if timestep is not None:
        require_positive("timestep", timestep, "give it in s")
    start = pose if state is None else state
    check_names(mechanism, start)
    ideal, replaced = _with_ideal_joints(mechanism)
    # Both `_places` return the place of each body in the tree of joints.
    writer = MjcfWriter(ideal, robot._places() if robot else _places(ideal), pose)
    if replaced:
        writer.omitted["clearances, replaced by ideal joints,"] += replaced
        for name, joint in mechanism.joints.items():
            if isinstance(joint, JointFriction) and joint.pressed_by in replaced:
                writer.omitted[OF_PRESSED].append(name)
    if robot:
        writer.add_robot(robot)
    elif not replaced:
        # Not for journals, which need not be centred as the ideal joints require, nor for a robot,
        # whose pose follows from the positions of its joints.
        writer.require_in_place(pose)
    content = writer.finish(location, start, timestep, integrator)
    warn_of_omitted(location, writer.omitted)
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
    armatures, dampers, springs and dry friction of hinges and sliders, and `SpringDamper`. Dry
    friction is that at 1 m/s or rad/s, without the elastic deflection of bristles. Joints that
    close loops, `JointCoupling` and constant `PrescribedAngle` are equality constraints, which are
    soft in MuJoCo. A `DriveTorque` or `Motor` is an actuator; the keyframe "start" has its control
    at time zero, and the `state`. Joints keep their names and positions.

    MuJoCo's recipe for backlash is two hinges in series, of which the second has a small range and
    a stiff limit. The flanks of a `Backlash`, or of a `PinInSlot` along a slider, become such a
    limit: of the hinge or slider between the two bodies or, if several joints are between them, of
    a fixed tendon, as with `Robot.with_drive`. The limit has the stiffness of the flanks and the
    damping of a `SpringDashpot`. For another law, it is a linear spring with the law's stored
    energy at a penetration of a tenth of the play, and with the law's restitution for an impact in
    the pose of the file. Each limit has the smallest impedance that MuJoCo accepts, 1e-4. With an
    impedance near one, MuJoCo's default, a limit sets an acceleration rather than a force, so that
    a load hardly deflects it. The numbers of the limits are for the masses in the file: after
    changes, write it again. Without play, `load_robot` reads a robot from its file as it was.

    Elements without counterpart are left out: `ClearanceJoint` and `BallInSocket` become ideal
    joints, and bodies on joints of other types are free. Limits of a robot's joints, without effect
    in a scene unless they are stops, act in MuJoCo.

    **Arguments:**

    - `scene`: a `Scene`, or a `Robot`.
    - `path`: of the file; an existing one is overwritten.
    - `state`: of the keyframe. A scene's file describes the bodies in this pose, a robot's with all
      joints at zero, which is also a robot's state by default.
    - `timestep`: s; by default a twentieth of the shortest period of a flank or spring in the pose
      of the file, at most 2 ms.
    - `integrator`: one of MuJoCo's: "Euler", "RK4", "implicit" or "implicitfast".

    **Raises:** `ValueError` for a state that the ideal joints do not allow, and for a scene that
    MuJoCo can't compile. `ImportError` without the extra ``mujoco``. **Warns:**
    `NotCarriedOverWarning` lists what the file lacks.
    """
    path = Path(path)
    _, content = mjcf_of(scene, state, FileLocation(str(path)), timestep, integrator)
    path.write_text(content, encoding="utf-8")
