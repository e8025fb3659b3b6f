"""Robots from URDF and MJCF files: their scene, and states from the positions of joints."""

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Literal, Protocol, TypeAlias

import jax
import numpy as np
from jaxtyping import PyTree
from typing_extensions import override

from .._dynamics.joint_coordinates import trees
from .._dynamics.joint_coordinates.coordinates import (
    decoded,
    encoded,
    inverse_dynamics,
    written_out,
)
from .._fields.cautions import quiet
from .._fields.checks import as_number, nearest, require, require_positive
from .._fields.types import TripleLike
from .._math.smoothing import TURN
from .._math.vectors import ZERO, EulerParameters, Scalar, Vector, library, pack, unpack
from .._model.bodies import GROUND, Body, BodyState, State
from .._model.contact.friction import FrictionLaw
from .._model.joints.base import AbstractForce
from .._model.joints.ideal import HingeOrSlider, RevoluteJoint
from .._model.joints.motion_subspaces import REST, Hinge, JointState, Relative
from .._model.scene import Scene
from . import robots
from .documents import FileLocation, read_bytes
from .drive_train import Drive, motor_name, rotor_name, train_of
from .files import FilePath
from .mjcf import read_mjcf
from .robot_elements import FRICTION, Element, Elements, Joint, Play, scene_of
from .urdf import LARGEST_FILE, read_urdf, root_tag

Positions: TypeAlias = PyTree
"""Positions, speeds or accelerations: a dictionary by the joint's name, or an array (..., n) for
all n hinges and sliders, in the order of `Robot.joints`; ``None`` for no entries."""
JointNumbers: TypeAlias = tuple[Scalar, ...]
NOTHING: Mapping[str, PyTree] = MappingProxyType({})
REST_OF_A_JOINT = JointState(0.0, (0.0,))
FOLLOWS = 1e-6
"""Largest difference between a follower's given and derived position, rad or m, or speed."""


class HasStates(Protocol):
    """A solution or trajectory, with states at N times."""

    @property
    def states(self) -> State:
        """The `State` whose arrays have a first axis of length N."""
        ...


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot from a file: its scene, and how the scene's states follow from joint positions.

    Positions are those of the file: angles, rad, of hinges, and distances, m, of sliders. They keep
    this meaning if numbers of the scene, such as lengths, are changed.

    - `scene`: bodies, joints and forces.
    - `joints`: names of the hinges and sliders, in the order of the file.
    - `limits`: limits of those joints that have any, by name.
    - `links`: body to which each link belongs, and frame of the link in this body, by name.
    - `actuators`: actuators of an MJCF file, by name.
    - `leaders`: for each joint that follows another (``mimic``), the name of that joint.
    - `drives`: the drive trains that `with_drive` has added, by name of the joint.

    ```python
    import clearjoint as cj

    robot = cj.load_robot("arm.urdf")
    state = robot.state({"elbow": 0.3}, {"elbow": -1.0})  # rad, rad/s
    print(robot.angles(state), robot.torques({"elbow": 0.3}))
    ```
    """

    scene: Scene
    joints: tuple[str, ...]
    limits: Mapping[str, robots.JointLimits]
    links: Mapping[str, robots.LinkPose]
    actuators: Mapping[str, robots.Actuator]
    leaders: Mapping[str, str]
    _branches: Sequence[trees.TreeBranch]
    _start: State
    _mimics: dict[str, robots.Mimic]
    drives: Mapping[str, Drive] = field(default_factory=dict)

    @override
    def __repr__(self) -> str:
        return f"Robot with {len(self.scene.bodies)} bodies, joints {', '.join(self.joints)}"

    def with_drive(self, joint: str, drive: Drive) -> "Robot":
        """Return the robot with a drive train in a hinge or slider.

        Positions, speeds and limits of the joint remain those of the link, and so do the elements
        of the file that act on it: damping, friction, spring, stops and couplings are on the link's
        side. The armature of the file is that of the rotor, unless the drive has its own. With play
        or stiffness, the scene gets, for a joint "elbow":

        - the body "elbow rotor", with negligible mass and inertia, and the joint "elbow motor" by
          which the first body of "elbow" holds the rotor, and which has the armature. The position
          of "elbow motor" is the motor's angle over the ratio; `angles` has it too.
        - "elbow backlash", a `Backlash` (of sliders a `PinInSlot`), between rotor and link, or
          without play "elbow compliance", a `TorsionalSpring` (`Bushing`).
        - "elbow motor friction" and "elbow link friction", each a `JointFriction`.

        ```python
        import clearjoint as cj

        drive = cj.Drive(armature="2e-5 kg m^2", ratio=100.0, play="0.5 deg", stiffness=800.0)
        robot = cj.load_robot("arm.urdf").with_drive("elbow", drive)
        servo = cj.Motor(*robot.motor_side("elbow"), 0.3, proportional=50.0, derivative=2.0)
        robot = robot.with_elements({"elbow servo": servo})
        solution = cj.simulate(robot.scene, robot.state({"elbow": 0.1}), 1.0)
        ```

        **Raises:** `ValueError` for a joint with a drive or of another kind, and invalid numbers.
        """
        ideal = self._ideal("joint", joint)
        require(joint not in self.drives, "joint", joint, "without a drive", "leave it out")
        train = train_of(joint, ideal, drive)
        bodies, joints = self.scene.bodies, {**self.scene.joints, joint: train.joint}
        branches = list(self._branches)
        if train.rotor is not None:
            rotor, name = rotor_name(joint), motor_name(joint)
            expected, remedy = "no such body beside it", "rename that link"
            require(rotor not in bodies, "joint", rotor, expected, remedy)
            bodies = {**bodies, rotor: train.rotor}
            # States of the rotor follow from the position of its joint, the motor.
            motor = train.elements[name]
            assert isinstance(motor, HingeOrSlider)
            subspace = unpack(motor).motion_subspace(motor.first)
            branches.append(trees.JointedBranch(rotor, motor.first, name, subspace))
        robot = replace(self, _branches=branches, drives={**self.drives, joint: drive})
        return robot._with(bodies, joints, train.elements)

    def with_elements(self, elements: Mapping[str, Element]) -> "Robot":
        """Return the robot with further joints and forces of its scene, by name.

        **Raises:** `ValueError` for a name that the scene has already.
        """
        return self._with(self.scene.bodies, self.scene.joints, elements)

    def _with(
        self,
        bodies: Mapping[str, Body],
        joints: Mapping[str, Joint],
        elements: Mapping[str, Element],
    ) -> "Robot":
        joints, forces = dict(joints), dict(self.scene.forces)
        for name, element in elements.items():
            is_new = name not in joints and name not in forces
            expected = "a name that no joint or force of the scene has"
            require(is_new, "elements", name, expected, "choose another name")
            if isinstance(element, AbstractForce):
                forces[name] = element
            else:
                joints[name] = element
        with quiet():
            return replace(self, scene=Scene(bodies, joints, forces, self.scene.gravity))

    def motor_side(self, joint: str) -> tuple[str, str, np.ndarray]:
        """Return the names of the joint's first body and of its rotor, and the axis, (3,) in the
        first body's axes: the first arguments of a `Motor`, `DriveTorque` or `PrescribedAngle` that
        acts on the motor. Only a drive train with play or compliance has a rotor; without a rotor,
        the result is that of `link_side`.

        **Raises:** `ValueError` if no hinge or slider has this name.
        """
        first, second, axis = self.link_side(joint)
        return first, rotor_name(joint) if joint in self._motors() else second, axis

    def link_side(self, joint: str) -> tuple[str, str, np.ndarray]:
        """Return the names of the joint's first and second body, and the axis, (3,) in the first
        body's axes: the first arguments of an element that acts on the second body, not on a rotor.

        **Raises:** `ValueError` if no hinge or slider has this name.
        """
        ideal = self._ideal("joint", joint)
        axis = ideal.axis_first if isinstance(ideal, RevoluteJoint) else ideal.axis
        return ideal.first, ideal.second, np.asarray(axis)

    def _places(self) -> list[trees.Place]:
        return [trees.Place(b.body, b.parent, getattr(b, "joint", None)) for b in self._branches]

    def _ideal(self, argument: str, name: str) -> HingeOrSlider:
        ideal = {n: self.scene.joints[n] for n in self.joints}
        ideal = {n: joint for n, joint in ideal.items() if isinstance(joint, HingeOrSlider)}
        remedy = nearest(name, ideal, "a joint with clearance has no drive")
        expected = f"one of the ideal hinges and sliders {', '.join(ideal)}"
        require(name in ideal, argument, name, expected, remedy)
        return ideal[name]

    def state(
        self, q: Positions = None, qd: Positions = None, *, free: Mapping[str, BodyState] = NOTHING
    ) -> State:
        """Return the state of the scene's bodies for positions and speeds of the joints.

        JAX may trace the numbers. Joints with clearance are centred. Joints that close loops need
        not be satisfied: `assemble` then corrects the state.

        **Arguments:**

        - `q`, `qd`: positions, rad or m, and speeds, rad/s or m/s: a dictionary by joint, or an
          array (..., n) in the order of `joints`. Joints without an entry are at zero and at rest,
          or follow their leader. Entries may be arrays, for many states at a time. A ball joint has
          four Euler parameters from the child's to the parent's frame, scalar first, and as speeds
          the spin, (3,) rad/s, in the child's axes. A motor of `with_drive` has by default the
          position of its joint: the link is then in the middle of the play. If the entry of "elbow
          motor" is that of "elbow" plus half the play, the link rests on the lower flank of the
          play; if it is that of "elbow" minus half the play, on the upper flank.
        - `free`: `body_state` of bodies that no joint holds, by name; by default at rest where the
          file puts them.

        **Raises:** `ValueError` if a joint or body is unknown, or if the entry of a joint with a
        leader contradicts the one of its leader.
        """
        bodies = decoded(written_out(self._branches), self._moved(q, qd, free))
        shape = np.broadcast_shapes(*map(np.shape, jax.tree.leaves(bodies)))

        # Every number gets the shape of all entries together, such as (N,) for N states.
        def broadcast(number: Scalar) -> Scalar:
            return library((number,)).broadcast_to(number, shape)

        # Body by body: JAX would sort the names.
        return State({n: pack(jax.tree.map(broadcast, bodies[n])) for n in self.scene.bodies})

    def moved(self, state: State, q: Positions = None, qd: Positions = None) -> State:
        """Return a state in which some joints have other positions or speeds than in `state`.

        **Arguments:** `state`: JAX may trace it. `q`, `qd`: positions and speeds, in the forms that
        the method `state` accepts; joints without an entry keep their positions, or their speeds.

        **Raises:** `ValueError` as the method `state`.
        """
        new = self._by_joint("q", q, False), self._by_joint("qd", qd, True)
        # Without the old numbers of followers: `state` derives them from those of the leaders.
        positions, speeds = (
            {n: value for n, value in part.items() if n not in self._mimics}
            | {n: _number(value) for n, value in changed.items()}
            for part, changed in zip(self._coordinates(state), new, strict=True)
        )
        free = [b.body for b in self._branches if isinstance(b, trees.FreeBranch)]
        return self.state(positions, speeds, free={body: state.bodies[body] for body in free})

    def angles(self, motion: State | HasStates) -> dict[str, np.ndarray]:
        """Return the positions of all joints by name, rad or m: the inverse of `state`.

        **Arguments:** `motion`: a state, or a solution with saved states, at N times. Angles of a
        state are within half a revolution of the middle of the joint's limits or, without limits,
        of zero; angles of a solution continue over revolutions if more than two states are saved
        for each revolution. A ball joint has its Euler parameters, (4,) or (N, 4).
        """
        return self._coordinates(motion)[0]

    def speeds(self, motion: State | HasStates) -> dict[str, np.ndarray]:
        """Return the speeds of all joints by name, rad/s or m/s; `motion` as in `angles`."""
        return self._coordinates(motion)[1]

    def torques(
        self, q: Positions = None, qd: Positions = None, qdd: Positions = None
    ) -> dict[str, np.ndarray]:
        """Return the torques, N m, and forces, N, of drives in all joints that make a given motion.

        The torques come from inverse dynamics, with gravity, and springs and dampers of the file,
        but without dry friction, stops and joints that close loops. The torque of a leader also
        moves its followers, whose torques are zero. The torque of a joint with a drive also moves
        the rotor, which turns with the joint. Free bodies are held at rest.

        **Arguments:** `q`, `qd`, `qdd`: positions, speeds and accelerations, as in `state`.

        **Raises:** `ValueError` as `state`.
        """
        variables = self._moved(q, qd, free=NOTHING)
        rates = self._by_joint("qdd", qdd, speeds=True)  # of the speeds: accelerations
        # Accelerations of followers, by the chain rule; leaders come before their followers. A
        # follower without a leader stays at a constant position.
        slopes = {}
        for name, mimic in self._mimics.items():
            leader = REST_OF_A_JOINT
            if mimic.leader is not None:
                leader = variables[self._jointed[mimic.leader].body]
            assert isinstance(leader, JointState)
            _, slopes[name], curvature = _polynomial(mimic, leader.position)
            change = slopes[name] * rates.get(mimic.leader or "", (0.0,))[0]
            rate = change + curvature * leader.speeds[0] ** 2
            _require_following("qdd", rates, name, mimic, rate)
            rates[name] = (rate,)
        # The rotor of a drive turns with the joint, unless its own rate is given.
        for name, motor in self._motors().items():
            rates.setdefault(motor, rates.get(name, (0.0,)))
        torques = inverse_dynamics(unpack(self.scene), self._branches, variables, rates)
        # These are the torques on bodies: armatures come in addition.
        for name, joint in self.scene.joints.items():
            if getattr(joint, "armature", None) is not None and name in torques:
                (of_bodies,), (rate,) = torques[name], rates.get(name, (0.0,))
                torques[name] = [of_bodies + joint.armature * rate]
        # The drive of a joint moves the rotor too: its torque is the sum; the rotor has no entry.
        for name, motor in self._motors().items():
            (of_link,), (of_rotor,) = torques[name], torques.pop(motor)
            torques[name] = [of_link + of_rotor]
        # The leader does the work of its followers: by virtual work, their torques count times the
        # derivative of their positions by its position. Followers of followers come first.
        for name, mimic in reversed(self._mimics.items()):
            if mimic.leader is not None:
                (of_leader,), (of_follower,) = torques[mimic.leader], torques[name]
                torques[mimic.leader] = [of_leader + slopes[name] * of_follower]
            torques[name] = [0.0 * torques[name][0]]  # zeros in the shape of the others
        return self._ordered({name: _number(parts) for name, parts in torques.items() if parts})

    @cached_property
    def _jointed(self) -> dict[str, trees.JointedBranch]:
        """The branch of the body that each joint carries, by name of the joint."""
        branches = self._branches
        return {b.joint: b for b in branches if isinstance(b, trees.JointedBranch)}

    def _ordered(self, by_joint: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {name: by_joint[name] for name in dict.fromkeys((*self.joints, *by_joint))}

    def _motors(self) -> dict[str, str]:
        """Return the name of the motor's joint, "elbow motor", by joint with a separate rotor."""
        return {n: motor_name(n) for n in self.drives if motor_name(n) in self._jointed}

    def _by_joint(self, argument: str, values: Positions, speeds: bool) -> dict[str, JointNumbers]:
        """Check what the user passed as `argument`: positions of joints or, if `speeds`, speeds or
        accelerations. Return the numbers of each joint that has an entry, by name."""
        if values is None:
            return {}
        if not isinstance(values, Mapping):
            count, shape = len(self.joints), np.shape(values)
            expected = f"an array (..., {count}), or numbers by name, of the robot's joints"
            remedy = "give one for each of " + ", ".join(self.joints)
            require(shape[-1:] == (count,), argument, shape, expected, remedy)
            values = dict(zip(self.joints, _columns(values, argument), strict=True))
        by_joint = {}
        for name, value in values.items():
            remedy = nearest(name, self._jointed, "leave it out")
            expected = f"one of the joints {', '.join(self._jointed)}"
            require(name in self._jointed, argument, name, expected, remedy)
            value = as_number(value, f"{argument}[{name!r}]")
            # The state at zero tells how many numbers the joint has: a ball has four and three.
            zero = _zero(self._jointed[name])
            count = len(zero.speeds if speeds else jax.tree.leaves(zero.position))
            where = f"{argument}[{name!r}]"
            parts = (value,) if len(zero.speeds) == 1 else tuple(_columns(value, where))
            expected, remedy = f"{count} numbers of joint {name!r}", "give that many"
            require(len(parts) == count, argument, np.shape(value), expected, remedy)
            by_joint[name] = tuple(_as_number(part, where) for part in parts)
            for part in by_joint[name]:
                is_finite = isinstance(part, jax.Array) or bool(np.isfinite(part).all())
                expected, remedy = f"finite numbers of joint {name!r}", "leave unknown ones out"
                require(is_finite, argument, value, expected, remedy)
        return by_joint

    def _moved(
        self, q: Positions, qd: Positions, free: Mapping[str, BodyState]
    ) -> dict[str, JointState | BodyState]:
        """Return the variables of all bodies, by name, for positions and speeds of joints and for
        the states `free` of free bodies; all three may be incomplete, as in `state`."""
        positions = self._by_joint("q", q, speeds=False)
        speeds = self._by_joint("qd", qd, speeds=True)
        shapes = [np.shape(part) for part in chain(*positions.values(), *speeds.values())]
        try:
            np.broadcast_shapes(*shapes)
        except ValueError:
            expected, remedy = "arrays of equal lengths", "give as many of each joint"
            require(False, "q and qd", sorted(set(shapes)), expected, remedy)
        # Complete the numbers of followers, after those of their leaders, and of motors. A follower
        # without a leader is at a constant position; the text "" names no joint.
        for name, mimic in self._mimics.items():
            y, slope, _ = _polynomial(mimic, positions.get(mimic.leader or "", (0.0,))[0])
            rate = slope * speeds.get(mimic.leader or "", (0.0,))[0]
            _require_following("q", positions, name, mimic, y)
            _require_following("qd", speeds, name, mimic, rate)
            positions[name], speeds[name] = (y,), (rate,)
        for name, motor in self._motors().items():
            for numbers in (positions, speeds):
                numbers.setdefault(motor, numbers.get(name, (0.0,)))
        of_free = {b.body for b in self._branches if isinstance(b, trees.FreeBranch)}
        for body in free:
            remedy = nearest(body, of_free, "set the positions of its joints")
            expected = f"one of the free bodies, {', '.join(sorted(of_free)) or 'none'}"
            require(body in of_free, "free", body, expected, remedy)
        variables: dict[str, JointState | BodyState] = {}
        for branch in self._branches:
            if isinstance(branch, trees.FreeBranch):
                state = free.get(branch.body, self._start.bodies[branch.body])
                variables[branch.body] = _in_scalars(state)
                continue
            zero = _zero(branch)
            leaves, structure = jax.tree.flatten(zero.position)
            position = positions.get(branch.joint, tuple(leaves))
            speed = speeds.get(branch.joint, zero.speeds)
            variables[branch.body] = JointState(jax.tree.unflatten(structure, position), speed)
        return variables

    def _coordinates(
        self, motion: State | HasStates
    ) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        states = motion if isinstance(motion, State) else motion.states
        variables = variables_of(self._branches, states)
        positions, speeds = {}, {}
        joints = {motor: name for name, motor in self._motors().items()}  # the joint of each motor
        for branch in self._branches:
            variable = variables[branch.body]
            # Free bodies, and bodies that are fixed to their parents, have no position of a joint.
            if isinstance(branch, trees.FreeBranch) or not variable.speeds:
                continue
            value = _number(jax.tree.leaves(variable.position))
            if isinstance(branch.motion_subspace, Hinge):
                # A state determines an angle up to whole turns. The one nearest to the middle of
                # the limits is meant; a motor has the limits of its joint.
                joint = joints.get(branch.joint, branch.joint)
                limits = self.limits.get(joint, robots.JointLimits())
                middle = 0.5 * (limits.lower + limits.upper)
                middle = middle if math.isfinite(middle) else 0.0
                value = value - TURN * np.round((value - middle) / TURN)
                # Angles of a solution continue over revolutions.
                value = value if motion is states else np.unwrap(value)
            positions[branch.joint], speeds[branch.joint] = value, _number(variable.speeds)
        return self._ordered(positions), self._ordered(speeds)


def variables_of(branches: Sequence[trees.TreeBranch], state: State) -> dict[str, PyTree]:
    """Return the `JointState` of each body on a joint, and the `BodyState` of each free body, by
    the body's name, with arrays (N,) for states at N times. `branches`: parents first."""
    bodies = {branch.body: _in_scalars(state.bodies[branch.body]) for branch in branches}
    return encoded(written_out(branches), bodies)


def kinematics(robot: Robot) -> Hashable:
    """Return a key that is equal for robots whose bodies move alike if their joints move alike."""
    limits, mimics = frozenset(robot.limits.items()), frozenset(robot._mimics.items())
    return robot.joints, tuple(robot._branches), limits, mimics, frozenset(robot.drives)


def _zero(branch: trees.JointedBranch) -> JointState:
    return branch.motion_subspace.encode(Relative(trees.UPRIGHT, ZERO, REST))


def _as_number(value: PyTree, argument: str) -> Scalar:
    array = as_number(value, argument)
    plain = isinstance(array, np.ndarray) and array.shape == ()
    return float(array) if plain else array  # pyright: ignore


def _columns(values: PyTree, argument: str) -> list[PyTree]:
    array = as_number(values, argument)
    return [array[..., k] for k in range(array.shape[-1])] if array.ndim else [array]


def _in_scalars(body: BodyState) -> BodyState:
    parts = body.position, body.orientation, body.velocity, body.spin
    kinds = Vector, EulerParameters, Vector, Vector
    return BodyState(
        *(kind(*_columns(part, "state")) for kind, part in zip(kinds, parts, strict=True))
    )


def _number(parts: Sequence[Scalar]) -> np.ndarray:
    xp = library(parts)
    if len(parts) == 1:
        return xp.asarray(parts[0])
    return xp.stack(xp.broadcast_arrays(*parts), axis=-1)  # pyright: ignore


def _polynomial(mimic: robots.Mimic, x: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Return a follower's position, and its first two derivatives by `x`, the leader's position."""
    # Horner's scheme for the polynomial, its derivative, and half its second derivative.
    value = slope = half_curvature = 0.0
    for coefficient in reversed(mimic.coefficients):
        half_curvature = half_curvature * x + slope
        slope = slope * x + value
        value = value * x + coefficient
    return value, slope, 2.0 * half_curvature


def _require_following(
    argument: str, numbers: dict[str, JointNumbers], name: str, mimic: robots.Mimic, derived: Scalar
) -> None:
    # Arrays of JAX, whose numbers may be traced, are not compared.
    if name not in numbers or isinstance(numbers[name][0], jax.Array):
        return
    if isinstance(derived, jax.Array):
        return
    follows = bool((np.abs(numbers[name][0] - derived) <= FOLLOWS).all())
    what = "constant" if mimic.leader is None else f"that which follows from joint {mimic.leader!r}"
    remedy = "leave it out of the dictionary"
    require(follows, f"{argument}[{name!r}]", numbers[name][0], f"{what}, {derived}", remedy)


def load_robot(
    path: FilePath,
    play: Mapping[str, Play] = NOTHING,
    gravity: TripleLike | Literal["file"] | None = "file",
    *,
    stops: Mapping[str, Play] = NOTHING,
    friction: FrictionLaw | None = FRICTION,
    merge_fixed: bool = True,
    free_root: bool = False,
    balance_inertia: bool = False,
    bound_mass: float = 0.0,
    bound_inertia: float = 0.0,
) -> Robot:
    """Read a robot from a URDF or MJCF file, with play in some of its joints.

    ```python
    import clearjoint as cj

    elbow = {
        "bearing_radius": 10e-3,
        "clearance": 0.05e-3,
        "journal_length": 20e-3,
        "law": cj.laws.LankaraniNikravesh(0.9, cj.laws.RavnStiffness(207e9, 0.3)),
    }
    wrist = {"backlash": "0.1 deg", "torsional_stiffness": "2e4 N m/rad"}
    robot = cj.load_robot("arm.urdf", play={"elbow": elbow, "wrist": wrist})
    scene, state = robot.scene, robot.state({"wrist": 0.2})
    ```

    The root link (in MJCF, the world) is the ground. Links that move relative to their parents
    become bodies; links that are fixed to their parents are parts of them (`Robot.links` tells
    where). Joints keep their names; the child of a floating joint is free. A moving link named
    "ground" is the body "ground link".

    The frames of all bodies are parallel to the root's frame while all joints are at zero, so that
    a joint's angle (`quantities.JointAngle`), the middle of a backlash, and the angle of a drive
    about the joint's axis are those of the file. The axis of a joint has the same components in
    both bodies: ``robot.scene.joints["wrist"].axis_first`` is the axis of a drive.

    Further elements of the scene, for a joint "elbow" of the file:

    - "elbow coupling": a `JointCoupling` if it follows another joint (``mimic``, ``equality``).
    - "elbow damping", or "elbow spring" with a stiffness: a `TorsionalSpring` or, for sliders, a
      `Bushing`.
    - "elbow friction": a `JointFriction`, with the dry friction of the file as its load.
    - The constraints ``connect`` and ``weld`` of MJCF: a `SphericalJoint` and a `FixedJoint`.

    **Arguments:**

    - `path`: of the file. MJCF files need the extra ``mujoco``.
    - `play`: a dictionary of arguments for each revolute or continuous joint with play, by the
      joint's name. Numbers may be texts with units. There are two kinds:
        - Arguments of a `ClearanceJoint`, which replaces the joint. Bodies, points and axes are
          those of the file: the parent has the bearing, the child the journal. `axial` is
          `FixedAxially()` by default.
        - ``"backlash"``, an angle in rad, and arguments of a `Backlash`, which is added to the
          scene with a name such as "elbow backlash"; the joint stays. By default its
          `torsional_stiffness` is such that the joint's effort limit in the file deflects the
          surfaces in contact (flanks) by a tenth of the backlash.
    - `gravity`: (3,) m/s^2, or ``None``; by default an MJCF file's, and (0, 0, -9.81) for URDF.
    - `stops`: a dictionary of arguments for each joint whose limits are stops, by the joint's
      name: of hinges the `torsional_stiffness` and `restitution`, or the `law` and `radius`, of a
      `Backlash`; of sliders the `law` of a `PinInSlot`. This element is added with a name such as
      "elbow stop". Other limits have no effect on the motion (`Robot.limits` has them).
    - `friction`: law of dry friction in the joints, as for `JointFriction`. The law gives the ratio
      of the friction to the dry friction in the file, at speeds in rad/s or m/s. ``None`` leaves
      dry friction out.
    - `merge_fixed`: False makes fixed links with mass bodies of their own, held by a `FixedJoint`,
      whose reaction can then be observed. Merged links make runs faster.
    - `free_root`: True makes the root a free body, as for a robot that walks or a single object.
    - `balance_inertia`: True replaces the principal moments of a link by their mean if no rigid
      body can have them, as MuJoCo's compiler does with `balanceinertia`.
    - `bound_mass`, `bound_inertia`: least mass, kg, and least principal moment of inertia, kg m^2,
      of a body, as for MuJoCo's compiler. Smaller ones are increased. Links without mass between
      hinges and sliders, as between several joints of a body in MJCF, need no mass (see `Body`).

    **Raises:** `ValueError`, with the file and the element, for a file of more than 50 MB or that
    can't be read, a robot that a scene can't represent, and invalid `play` or `stops`. `OSError`
    for a file that does not exist. `ImportError` for an MJCF file without MuJoCo.

    **Warns:** `NotCarriedOverWarning` lists the contents of the file that the robot lacks, such as
    shapes; and the links and bodies whose masses and inertias were replaced.
    """
    for name, bound in (("bound_mass", bound_mass), ("bound_inertia", bound_inertia)):
        require_positive(name, bound, "give zero for no bound", zero=True)
    known, expected = not isinstance(gravity, str) or gravity == "file", 'numbers, None or "file"'
    require(known, "gravity", gravity, expected, "pass (0, 0, -9.81), say")
    location = FileLocation(str(path))
    is_mjcf = root_tag(read_bytes(Path(path), LARGEST_FILE)) == "mujoco"
    content = (read_mjcf if is_mjcf else read_urdf)(Path(path))
    options = robots.Options(merge_fixed, free_root, balance_inertia, bound_mass, bound_inertia)
    tree = robots.LinkTree(content, location, options)
    acceleration = content.gravity if isinstance(gravity, str) else gravity
    scene, state, elements = scene_of(tree, content.loops, play, stops, friction, acceleration)
    robot = _robot(tree, scene, state, elements, content)
    omitted = content.omitted | elements.omitted
    base = tree.carriers[tree.root]
    massive = [name for name, inertial in tree.massive(base).items() if inertial.mass > 0.0]
    if base.body == GROUND and massive:
        omitted["inertia of the fixed links"] = massive
    robots.warn_of_omitted(path, omitted)
    return robot


def _robot(
    tree: robots.LinkTree, scene: Scene, state: State, elements: Elements, content: robots.Content
) -> Robot:
    of_child = {joint.child: joint for joint in tree.joints.values()}  # the joint of each child
    branches: list[trees.TreeBranch] = []
    # Links that form one body share a carrier; the joint to the parent is that of the first link.
    # The carriers are in the order of the tree, each before those that it carries.
    for carrier in {id(carrier): carrier for carrier in tree.carriers.values()}.values():
        joint = of_child.get(carrier.links[0])
        if carrier.body == GROUND:
            continue
        if joint is None or joint.kind == robots.FLOATING:  # a free root, or a free child
            branches.append(trees.FreeBranch(carrier.body, anchor=None))
            continue
        parent = tree.carriers[joint.parent].body
        subspace = unpack(elements.ideal[joint.name]).motion_subspace(parent)
        branches.append(trees.JointedBranch(carrier.body, parent, joint.name, subspace))
    moving = [j for j in content.joints if j.name in elements.ideal]
    names = tuple(j.name for j in moving if j.kind in (*robots.HINGES, robots.SLIDER))
    followed = {name: mimic.leader for name, mimic in elements.mimics.items() if name in names}
    return Robot(
        scene,
        names,
        {j.name: j.limits for j in moving if j.limits is not None},
        {link.name: tree.frame(link.name) for link in content.links},
        dict(content.actuators),
        {name: leader for name, leader in followed.items() if leader is not None},
        branches,
        state,
        elements.mimics,
    )
