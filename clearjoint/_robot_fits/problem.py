"""The scene, the parameters and the measurements of the fit of a robot to its log."""

import abc
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, NamedTuple, TypeAlias, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from typing_extensions import override

from .._fields.checks import as_number, nearest, require, require_type
from .._math.vectors import Scalar
from .._measurements.robot_logs import Logged, RobotLog
from .._measurements.series import Measurements, Series
from .._model.bodies import State
from .._model.clearance_joints.backlash import Backlash
from .._model.contact.friction import RegularisedCoulomb
from .._model.drives.drivers import AbstractDriveTorque, DriveTorque
from .._model.drives.functions_of_time import PiecewiseConstant, Spline, value_and_rate
from .._model.drives.servo import Servo
from .._model.forces import TorsionalSpring
from .._model.joints.base import AbstractForce
from .._model.joints.ideal import HingeOrSlider, PrismaticJoint, RevoluteJoint
from .._model.joints.joint_friction import JointFriction
from .._model.scene import Scene
from .._parametrisation.parameter import Bounded, Linear, Log, Parameter
from .._parametrisation.paths import set_value, value_at
from .._parametrisation.variations import AbstractGroupedChange, SceneNumber
from .._scene_files.documents import FileLocation
from .._scene_files.drive_train import COMPLIANCE, motor_name
from .._scene_files.reading import number_of_text
from .._scene_files.robot import Robot, kinematics
from .._scene_files.robot_elements import BACKLASH, Element, friction_of, prescribed
from ..quantities.base import AbstractQuantity, Instant, Quantity
from ..quantities.drives import MotorTorque
from ..quantities.joints import JointAngle, Multiplier

KINDS = {
    "play": ("rad", None),
    "stiffness": ("N m/rad", None),
    "restitution": ("1", None),
    "friction": ("N m", "N"),
    "damping": ("N m s/rad", "N s/m"),
    "link friction": ("N m", "N"),
    "loss": ("1", "1"),
    "armature": ("kg m^2", "kg"),
    "inertia": ("kg m^2", None),
    "mass": ("kg", "kg"),
}
"""What a fit finds, with the units of hinges and of sliders, ``None`` for what sliders lack."""
Mode = Literal["angle", "torque", "held torque"]
"""How a joint follows the log: the argument `driven_by` of `fit_robot`."""
DrivenBy: TypeAlias = Mapping[str, Mode | AbstractForce]
Start: TypeAlias = float | str | None
"""Value from which a fit starts: a number, or a text with a unit; ``None`` for the robot's own."""
Find: TypeAlias = Mapping[str, Mapping[str, Start] | Sequence[str]]
COULOMB = RegularisedCoulomb(1.0, regularisation_speed=1e-4)
"""Law of a friction that is added to the robot; it allows longer steps than one with bristles."""
SHARE = 0.1
"""Share of the largest logged torque with which the fit of a friction or damping starts."""
FACTOR = 100.0
"""Ratio, 1/s, of the typical change of a speed at the start to the noise of the position."""
STILL = 1.5
"""Standard deviation of positions, over their noise, up to which a joint counts as not moving."""
REST, SLOPE = 10, 3.3
"""A joint starts at rest if the slope over time of its first `REST` positions is at most `SLOPE`
standard errors. Noise exceeds that in one of 1000 logs; a wrong start speed spoils estimates."""
POSITION, SPEED, IN_PLAY = OF_START = "start position", "start speed", "start in the play"
"""What a fit finds of the start; `IN_PLAY` is the place, from -1 to 1, in the play of a drive train
of which one side is not logged."""
CERTAIN = 10.0
"""A load's sign is certain if position errors of this multiple of the noise don't change it."""
UNKNOWN_NOISE = 1e-3
"""Noise, rad or m, that replaces an unknown one in the scale of a position at the start."""


class JointPosition(AbstractQuantity):
    """Position of a slider, m."""

    joint: str = eqx.field(static=True)
    unit = "m"

    @override
    def check(self, scene: Scene) -> None:
        pass  # `_require_joints` has checked the name

    @override
    def __call__(self, now: Instant) -> Scalar:
        joint = now.scene.joints[self.joint]
        assert isinstance(joint, PrismaticJoint)
        return joint.position(now.motions).value


@dataclass(frozen=True)
class LinkInertia:
    """Function that scales a body's inertia so that the moment of inertia about `axis`, a unit
    vector in body axes, through the centre of mass, has a given value, kg m^2."""

    body: str
    axis: tuple[float, ...]

    def moment(self, scene: Scene) -> Scalar:
        inertia, axis = jnp.asarray(scene.bodies[self.body].inertia), jnp.asarray(self.axis)
        return axis @ (inertia * axis if inertia.ndim == 1 else inertia @ axis)

    def __call__(self, scene: Scene, state: State, value: Scalar) -> tuple[Scene, State]:
        inertia = jnp.asarray(scene.bodies[self.body].inertia) * (value / self.moment(scene))
        return set_value(scene, lambda s: s.bodies[self.body].inertia, inertia), state


@dataclass(frozen=True)
class FlankStiffness:
    """Function that sets the stiffness of the flanks of a `Backlash`, N m/rad about its axis."""

    joint: str

    def __call__(self, scene: Scene, state: State, value: Scalar) -> tuple[Scene, State]:
        backlash = scene.joints[self.joint]
        assert isinstance(backlash, Backlash)
        # The law of the flanks has a force over a displacement at the radius, N/m.
        stiffness = value / jnp.asarray(backlash.radius) ** 2
        changed = set_value(
            scene, lambda s: s.joints[self.joint].law.stiffness.stiffness, stiffness
        )
        return changed, state


class MovedRobot:
    """A robot that computes states from joint positions, equal to all others of equal kinematics,
    so that fits to several logs, and fits from the results of others, share compiled programs."""

    def __init__(self, robot: Robot):
        self.robot, self._kinematics = robot, kinematics(robot)

    @override
    def __eq__(self, other: object) -> bool:
        return isinstance(other, MovedRobot) and self._kinematics == other._kinematics

    @override
    def __hash__(self) -> int:
        return hash(self._kinematics)


@dataclass(frozen=True)
class AbstractStart(AbstractGroupedChange):
    """Base class of functions that set joint positions or speeds of a robot in the initial state.
    `moved` holds the robot, which computes the bodies' states from those of all joints."""

    moved: MovedRobot

    @abc.abstractmethod
    def set_in(self, numbers: "StartNumbers", scene: Scene, value: Scalar) -> None:
        """Set the positions or speeds in `numbers` that follow from the `value` of this change and
        from the drive trains in `scene`, such as their play."""

    @staticmethod
    @override
    def make_all(
        scene: Scene, state: State, changes: Sequence[tuple["AbstractStart", Scalar]]
    ) -> tuple[Scene, State]:
        # The bodies' states are decoded and computed again once for all joints: one after the
        # other, those of a six-joint arm took three quarters of the time to trace a fit.
        numbers, robot = StartNumbers(state, {}, {}), changes[0][0].moved.robot
        for change, value in changes:
            change.set_in(numbers, scene, value)
        return scene, robot.moved(state, numbers.q, numbers.qd)


class StartNumbers(NamedTuple):
    """Start positions `q`, rad or m, and speeds `qd` of joints, by name, that replace `state`'s."""

    state: State
    q: dict[str, Scalar]
    qd: dict[str, Scalar]


@partial(
    jax.tree_util.register_dataclass,
    data_fields=["load"],
    meta_fields=["moved", "joint", "of_speed", "follower"],
)
@dataclass(frozen=True, eq=False)
class StartOfJoint(AbstractStart):
    """Function that gives a joint a position or, if `of_speed`, a speed at the start.

    `follower` is the other side of the joint's drive train if the log lacks that other side, else
    ``None``. The follower starts where `load`, N m or N, has taken up play and compliance. The load
    is an array, and so an argument of compiled programs, because it differs between logs.
    """

    joint: str
    of_speed: bool
    follower: str | None
    load: Scalar

    @override
    def set_in(self, numbers: StartNumbers, scene: Scene, value: Scalar) -> None:
        part = numbers.qd if self.of_speed else numbers.q
        part[self.joint] = value
        if self.follower is not None:
            lag = 0.0 if self.of_speed else wind_up(scene, self.follower, self.joint, self.load)
            part[self.follower] = value + lag


@dataclass(frozen=True)
class StartInPlay(AbstractStart):
    """Function that gives the joint `follower`, the side of a drive train that is not logged, a
    start position in the play of the joint `backlash`. It takes a value from -1, the lowest such
    position, to 1, the highest; 0 is the position of the joint `joint`, the logged side."""

    joint: str
    follower: str
    backlash: str

    @override
    def set_in(self, numbers: StartNumbers, scene: Scene, value: Scalar) -> None:
        half = 0.5 * scene.joints[self.backlash].play  # pyright: ignore
        logged = numbers.q.get(self.joint)
        # If its position is no parameter, the logged side is where the state has it.
        if logged is None:
            logged = self.moved.robot.angles(numbers.state)[self.joint]
        numbers.q[self.follower] = logged + value * half


@dataclass(frozen=True)
class GearLoss:
    """Function that sets the loss of a gear: friction over the torque that the gear transmits. Loss
    times `radius` is the `load_ratio` of the joint friction named `friction`. `radius` is 1 or, if
    a force between flanks transmits the torque, the lever of this force, m."""

    friction: str
    radius: float

    def __call__(self, scene: Scene, state: State, value: Scalar) -> tuple[Scene, State]:
        ratio = value * self.radius
        return set_value(scene, lambda s: s.joints[self.friction].load_ratio, ratio), state


def wind_up(scene: Scene, follower: str, leader: str, load: Scalar) -> Scalar:
    """Return by how much, rad, the joint `follower` is ahead of the joint `leader`, while the motor
    holds the link by the torque `load`, N m. One is the joint of a link, the other that of its
    motor. Without load the result is zero: the follower is in the middle of the play."""
    # Under a positive load the motor is ahead of the link.
    joint, sign = (follower, -1.0) if motor_name(follower) == leader else (leader, 1.0)
    backlash = scene.joints.get(backlash_name(joint))
    if isinstance(backlash, Backlash):
        stiffness = backlash.law.stiffness.stiffness * backlash.radius**2  # pyright: ignore
        return sign * (jnp.sign(load) * 0.5 * backlash.play + load / stiffness)
    compliance = scene.forces.get(f"{joint} {COMPLIANCE}")
    return sign * load / compliance.stiffness if isinstance(compliance, TorsionalSpring) else 0.0


@dataclass(frozen=True)
class RobotProblem:
    """A driven robot at the start of its log, its parameters, and what the log measures. `subjects`
    has the joint of each parameter and its kind, such as "play", by the name of the parameter."""

    robot: Robot
    log: RobotLog
    driven_by: DrivenBy
    state: State
    parameters: dict[str, Parameter]
    subjects: dict[str, tuple[str, str]]
    measurements: Measurements

    @property
    def scene(self) -> Scene:
        return self.robot.scene


def drive_name(joint: str) -> str:
    return f"{joint} drive"


def backlash_name(joint: str) -> str:
    return f"{joint} {BACKLASH}"


def motor_of(robot: Robot, joint: str) -> str:
    """Return the name of the motor's joint: "elbow motor", or `joint` without a separate rotor."""
    return robot._motors().get(joint, joint)


def robot_problem(robot: Robot, log: RobotLog, find: Find, driven_by: DrivenBy) -> RobotProblem:
    """Check that the arguments of `fit_robot` agree, and return the problem of the fit."""
    require_type("robot", robot, Robot, "a Robot", "pass that of load_robot")
    _require_joints(robot, log, find, driven_by)
    positions = {name: _smoothed(robot, name, samples) for name, samples in log.angles.items()}
    driven = _driven(robot, log, driven_by, positions)
    parameters: dict[tuple[str, str], Parameter] = {}
    for joint, kinds in find.items():
        side = 0 if is_hinge(robot, joint) else 1  # Index in each pair of units of `KINDS`.
        units = {kind: unit for kind, pair in KINDS.items() if (unit := pair[side]) is not None}
        expected, remedy = "a list or dictionary", 'pass ["friction"], say'
        require(not isinstance(kinds, str), f"find[{joint!r}]", kinds, expected, remedy)
        for kind, start in (kinds if isinstance(kinds, Mapping) else dict.fromkeys(kinds)).items():
            expected, remedy = f"one of {', '.join(units)}", nearest(kind, units, "leave it out")
            require(kind in units, f"find[{joint!r}]", kind, expected, remedy)
            where = f"find[{joint!r}][{kind!r}]"
            if isinstance(start, str):
                start = number_of_text(start, units[kind], FileLocation("find", (joint, kind)))
            positive = start is None or 0.0 < start < math.inf
            require(positive, where, start, "finite and positive", "pass None for the robot's")
            if kind in RESISTANCES:
                guess = _guess(log, positions, motor_of(robot, joint), joint, kind)
                driven, parameter = _with_friction(driven, joint, kind, start, guess, units[kind])
            else:
                parameter = _parameter(driven, joint, kind, start, units[kind])
            number = parameter.value
            if number is None and isinstance(parameter.variation, SceneNumber):
                number = float(value_at(driven.scene, parameter.variation.path))
            expected, remedy = "positive in the robot, or given", f'pass {{"{kind}": start}}'
            require(number is None or number > 0.0, where, number, expected, remedy)
            parameters[joint, kind] = parameter
    # A spline has a knot before the log, so that its second knot, with index 1, is the first time
    # of the log. A joint that is driven by its position follows the log from the start on.
    following = {motor_of(robot, joint) for joint, mode in driven_by.items() if mode == "angle"}
    q = {name: float(spline.values[1]) for name, spline in positions.items()}
    at_rest = {
        n
        for n in log.angles
        if n not in following and _begins_at_rest(log.angles[n], is_hinge(robot, n))
    }
    qd = {n: 0.0 if n in at_rest else float(spline.rates[1]) for n, spline in positions.items()}
    for n in following:
        # The first sample of such a joint may be a little later than the log's start, if each joint
        # is logged at times of its own.
        if log.angles[n].times[0] > log.start:
            q[n], qd[n] = map(float, value_and_rate(positions[n], log.start))
    for name in log.angles:
        # A joint that is not logged starts like its motor. The reverse case needs no line here:
        # `Robot.state` starts a motor like its joint.
        link = _other_side(robot, log, name)
        if link in robot.joints:
            q[link], qd[link] = q[name], qd[name]
    for name in log.angles:
        # The start of a joint or motor that does not follow the log is known only as accurately as
        # a single sample, so that it is a parameter.
        if name not in following:
            parameters |= _of_start(robot, log, name, q, qd)
    subjects = {f"{joint} {kind}": (joint, kind) for joint, kind in parameters}
    by_name = dict(zip(subjects, parameters.values(), strict=True))
    state, measured = robot.state(q, qd), _measured(robot, log, driven_by, following)
    _require_covered(robot, log, driven_by, float(measured.times()[-1]))
    return RobotProblem(driven, log, driven_by, state, by_name, subjects, measured)


def _require_joints(robot: Robot, log: RobotLog, find: Find, driven_by: DrivenBy) -> None:
    # Angles may be logged of a joint and of its motor, everything else of a joint only.
    sides = dict.fromkeys(side for j in robot.joints for side in (j, motor_of(robot, j)))
    for argument, part, names in (
        ("find", find, robot.joints),
        ("driven_by", driven_by, robot.joints),
        ("log.torques", log.torques, robot.joints),
        ("log.angles", log.angles, sides),
    ):
        for name in part:
            expected, remedy = f"one of {', '.join(names)}", nearest(name, names, "leave it out")
            require(name in names, argument, name, expected, remedy)
            joint, expected = robot.scene.joints[name], "an ideal hinge or slider"
            require_type(f"{argument}[{name!r}]", joint, HingeOrSlider, expected, "leave it out")


def _require_covered(robot: Robot, log: RobotLog, driven_by: DrivenBy, end: float) -> None:
    """Raise a `ValueError` unless the angles or torques that drive joints are logged from the start
    of the log to `end`, s. Two samples may be missing at either end: drives are extrapolated."""
    for joint, mode in driven_by.items():
        if isinstance(mode, AbstractForce):
            continue
        is_angle = mode == "angle"
        motor = motor_of(robot, joint)
        samples = log.angles[motor] if is_angle else log.torques[joint]
        first, last = samples.times[[0, -1]].tolist()
        missing = max(first - log.start, end - last)
        spare = 2.5 * float(np.median(np.diff(samples.times)))
        argument = f"log.angles[{motor!r}]" if is_angle else f"log.torques[{joint!r}]"
        actual = f"from {first:.6g} to {last:.6g} s"
        expected = f"from {log.start:.6g} to {end:.6g} s, since it drives {joint!r}"
        remedy = f"cut the log: log.between({max(first, log.start):.6g}, {min(last, end):.6g})"
        require(missing <= spare, argument, actual, expected, remedy)


def _of_start(
    robot: Robot, log: RobotLog, name: str, q: Mapping[str, float], qd: Mapping[str, float]
) -> dict[tuple[str, str], Parameter]:
    """Return, by joint and kind, the parameters that give the logged joint `name` a position and,
    unless it starts at rest, a speed at the start. If the other side of its drive train is neither
    logged nor pressed to a flank, that side's place in the play is a parameter too. `q` and `qd`
    are positions and speeds of joints at the start."""
    samples, unit = log.angles[name], "rad" if is_hinge(robot, name) else "m"
    noise = UNKNOWN_NOISE if samples.noise is None else samples.noise
    follower, moved = _other_side(robot, log, name), MovedRobot(robot)
    # The follower starts where this load, N m or N, has taken up play and compliance.
    load = 0.0 if follower is None else _load_at_start(robot, q, name, follower, noise)

    def start(value: float, size: float, unit: str, of_speed: bool) -> Parameter:
        change = StartOfJoint(moved, name, of_speed, follower, jnp.asarray(load))
        return Parameter.change(change, value, Linear(size), unit)

    # The unit of each coordinate is a typical error: the noise of the position, or for a speed
    # `FACTOR` times this noise.
    parameters = {(name, POSITION): start(q[name], noise, unit, of_speed=False)}
    if qd[name] != 0.0:  # zero is the known speed of a joint that starts at rest
        parameters[name, SPEED] = start(qd[name], FACTOR * noise, f"{unit}/s", of_speed=True)
    # A drive train and its backlash are named after the joint, not after the motor.
    joint = name if name in robot.drives else follower
    backlash = backlash_name(joint or "")
    is_loose = isinstance(robot.scene.joints.get(backlash), Backlash)
    # Without a load that presses it to a flank, the side that is not logged may be anywhere in the
    # play.
    if follower is not None and load == 0.0 and is_loose:
        change = StartInPlay(moved, name, follower, backlash)
        parameters[follower, IN_PLAY] = Parameter.change(change, 0.0, Bounded(-1.0, 1.0))
    return parameters


def is_hinge(robot: Robot, joint: str) -> bool:
    return not isinstance(robot.scene.joints[joint], PrismaticJoint)


def continuous(samples: Logged, is_angle: bool) -> Float[np.ndarray, " N"]:
    """Return logged positions of a joint; angles without jumps by a revolution."""
    return np.unwrap(samples.values) if is_angle else samples.values


def _other_side(robot: Robot, log: RobotLog, name: str) -> str | None:
    """Return the motor of the joint `name`, or the joint of the motor `name`. Return ``None`` if
    there is no such other side of the drive train, or if the log has the other side's positions."""
    motors = robot._motors()
    other = (motors | {motor: joint for joint, motor in motors.items()}).get(name)
    return None if other in log.angles else other


def _begins_at_rest(samples: Logged, is_angle: bool) -> bool:
    """Return whether noise explains the slope of a line through a joint's first `REST` samples (see
    `SLOPE`); false for unknown noise. Of angles (`is_angle`), jumps by a revolution are removed."""
    if samples.noise is None:
        return False
    times, values = samples.times[:REST], continuous(samples, is_angle)[:REST]
    offsets = times - times.mean()
    error = samples.noise / np.linalg.norm(offsets)  # of the slope
    return bool(abs(offsets @ values) / (offsets @ offsets) <= SLOPE * error)


def _load_at_start(
    robot: Robot, q: Mapping[str, float], name: str, follower: str, noise: float
) -> float:
    """Return the torque, N m, or force, N, with which a motor holds its link at positions `q` of
    the start; zero if errors of `CERTAIN` times `noise` in the position `q[name]` may change its
    sign. `name`: the logged side of the drive train; `follower`: the other."""
    joint = name if name in robot.drives else follower
    angles = {n: value for n, value in q.items() if n in robot.joints}
    # The load at the logged position, and at those that are wrong by `CERTAIN` times the noise.
    loads = [
        float(robot.torques({**angles, joint: q[name] + error})[joint])
        for error in (0.0, -CERTAIN * noise, CERTAIN * noise)
    ]
    return loads[0] if min(loads) > 0.0 or max(loads) < 0.0 else 0.0


def _smoothed(robot: Robot, joint: str, samples: Logged) -> Spline:
    """Return a cubic spline through `samples` of the angle or displacement of a robot's `joint` or,
    if their noise is known, one of few pieces that misses them by their noise (P. Dierckx, *Curve
    and Surface Fitting with Splines*, 1993). Jumps of angles by a revolution are removed first."""
    from scipy.interpolate import CubicSpline, UnivariateSpline

    _require_unit(f"log.angles[{joint!r}]", samples, "rad" if is_hinge(robot, joint) else "m")
    values = continuous(samples, is_hinge(robot, joint))
    if samples.noise is None or len(values) < 5:
        # A natural spline has no acceleration at its ends, where the joint may have one.
        spline, knots = CubicSpline(samples.times, values), samples.times
    else:
        # With s, the sum of the squared residuals over the noise is that of noise alone.
        weights = np.full(len(values), 1.0 / samples.noise)
        spline = UnivariateSpline(samples.times, values, weights, k=3, s=len(values))
        knots = spline.get_knots()
    # The spline's second derivative is not defined at its first and last knot, which therefore lie
    # beyond the log.
    beyond = samples.times[1] - samples.times[0]
    knots = np.concatenate([[knots[0] - beyond], knots, [knots[-1] + beyond]])
    return Spline(knots, spline(knots), spline.derivative()(knots))


def _require_unit(argument: str, samples: Logged, unit: str) -> None:
    remedy = "correct the unit of its column"
    require(samples.unit in (unit, None), argument, samples.unit, f"in {unit}", remedy)


def _driven(
    robot: Robot, log: RobotLog, driven_by: DrivenBy, positions: Mapping[str, Spline]
) -> Robot:
    for joint, mode in driven_by.items():
        element = mode
        if isinstance(element, AbstractForce):
            # A drive of the user's follows the logged goals, if there are any.
            if joint in log.goals and hasattr(element, "target"):
                times, goals, _, _ = log.goals[joint]
                _require_unit(f"log.goals[{joint!r}]", log.goals[joint], "rad")
                element = replace(element, target=PiecewiseConstant(times, goals))
        else:
            element = _following(robot, log, joint, element, positions)
        robot = robot.with_elements({drive_name(joint): element})
    return robot


def _following(
    robot: Robot, log: RobotLog, joint: str, mode: Mode, positions: Mapping[str, Spline]
) -> Element:
    """Return the driver by which a joint follows its logged torque or its `positions`, smoothed."""
    argument, modes = f"driven_by[{joint!r}]", get_args(Mode)
    expected = f"one of {', '.join(modes)}, or a drive such as a Servo"
    require(mode in modes, argument, mode, expected, "name one of them")
    # Positions are prescribed to the motor; torques of the motor are logged by the joint's name.
    motor = motor_of(robot, joint)
    field, name = ("angles", motor) if mode == "angle" else ("torques", joint)
    expected, remedy = f"what the log has for {name!r}", f"pass {field} of {name!r} to the log"
    require(name in getattr(log, field), argument, mode, expected, remedy)
    if mode == "angle":
        ideal = robot.scene.joints[motor]
        assert isinstance(ideal, HingeOrSlider)
        return prescribed(ideal, positions[motor])
    _require_unit(f"log.torques[{joint!r}]", log.torques[joint], "N m")
    remedy = "drive the slider by its position, or add the load to the robot's scene"
    require(is_hinge(robot, joint), argument, mode, "of a hinge", remedy)
    # A held torque acts until the next logged value; others are interpolated.
    make = PiecewiseConstant if mode == "held torque" else Spline.through
    torque = make(log.torques[joint].times, log.torques[joint].values)
    return DriveTorque(*robot.motor_side(joint), torque)


RESISTANCES = "friction", "damping", "link friction"


def _guess(
    log: RobotLog, positions: Mapping[str, Spline], motor: str, joint: str, kind: str
) -> float | None:
    """Return a first guess, in SI units, of a friction or damping (`kind`) that the robot lacks, or
    ``None`` without logged torques. `positions`: the log's, smoothed, by name of joint or motor."""
    if joint not in log.torques:
        return None
    torque = SHARE * float(np.abs(log.torques[joint].values).max())
    moving = positions.get(motor, positions.get(joint))
    if kind != "damping" or moving is None:
        return torque
    # A damping with this torque at the largest speed.
    return torque / max(float(np.abs(moving.rates).max()), 1e-12)


def _friction_name(robot: Robot, joint: str, kind: str) -> str:
    # Name of the robot's friction of this kind, or the name that a new one gets.
    of_link = kind == "link friction"
    ends = ("friction", "link friction") if of_link else ("motor friction", "friction")
    names = [f"{joint} {end}" for end in ends]
    # If the motor turns apart, "friction" and "damping" act on the motor, not on the link.
    if not of_link and motor_of(robot, joint) != joint:
        return names[0]
    return next((name for name in names if name in robot.scene.joints), names[1])


def _with_friction(
    robot: Robot, joint: str, kind: str, start: float | None, guess: float | None, unit: str
) -> tuple[Robot, Parameter]:
    """Return the robot and the parameter of a joint's resistance of a `kind` in `RESISTANCES`; a
    missing resistance is added. Only "link friction" acts on the link's side of a drive train. The
    first guess is `start`, or else the robot's number, if positive, or else `guess`."""
    name, damper = _friction_name(robot, joint, kind), _damper(robot, joint)
    damper = damper if kind == "damping" else None
    # The friction is the law's ratio times the load: of these two, the load is the parameter.
    number = "viscosity" if kind == "damping" else "load"

    def path(scene: Scene) -> Scalar:
        if damper is not None:
            return scene.forces[damper].damping
        return getattr(scene.joints[name], number)

    present = robot.scene.joints.get(name)
    is_known = damper is not None or getattr(present, number, None) is not None
    known = float(as_number(path(robot.scene))) if is_known else 0.0
    first = start if start is not None else known if known > 0.0 else guess
    expected = "given, since the robot has none and the log no torque of the joint"
    remedy = f'pass {{"{kind}": start}}'
    require(first is not None, f"find[{joint!r}][{kind!r}]", first, expected, remedy)
    parameter = Parameter(path, Log(), value=first, unit=unit)
    if is_known:
        return robot, parameter
    # A friction always has a load, so that it is the viscosity that is missing.
    if isinstance(present, JointFriction):
        joints = {**robot.scene.joints, name: replace(present, viscosity=first)}
        return replace(robot, scene=replace(robot.scene, joints=joints)), parameter
    ideal = robot.scene.joints[joint if kind == "link friction" else motor_of(robot, joint)]
    assert isinstance(ideal, HingeOrSlider)
    load, viscosity = (0.0, first) if kind == "damping" else (first, None)
    friction = friction_of(ideal, COULOMB, load, viscosity=viscosity)
    return robot.with_elements({name: friction}), parameter


def _damper(robot: Robot, joint: str) -> str | None:
    # Name of the force that damps a hinge without a motor of its own, if there is one. A damping of
    # other joints is the viscosity of a friction.
    if motor_of(robot, joint) != joint or not is_hinge(robot, joint):
        return None
    names = f"{joint} damping", f"{joint} spring"
    return next((name for name in names if name in robot.scene.forces), None)


def _parameter(robot: Robot, joint: str, kind: str, start: float | None, unit: str) -> Parameter:
    """Return the parameter `kind`, one of `KINDS` except `RESISTANCES`, of a joint, with the value
    `start`, in `unit`, by default the robot's. Raise a `ValueError` if the robot lacks it."""
    scene, argument, scale = robot.scene, f"find[{joint!r}]", Log()
    ideal, motor = scene.joints[joint], scene.joints[motor_of(robot, joint)]
    if kind in ("play", "stiffness", "restitution"):
        return _of_gear(robot, joint, kind, start)
    assert isinstance(ideal, HingeOrSlider) and isinstance(motor, HingeOrSlider)
    if kind == "loss":
        name = _friction_name(robot, joint, "friction")
        friction, backlash = scene.joints.get(name), scene.joints.get(backlash_name(joint))
        loses = isinstance(friction, JointFriction) and friction.load_ratio is not None
        remedy = f"robot.with_drive({joint!r}, cj.Drive(stiffness=..., loss=0.1, ...)) adds it"
        require(loses, argument, kind, "of a joint whose drive has a loss", remedy)
        assert isinstance(friction, JointFriction)
        # Flanks press with a force, N, a rigid gear with a torque: see `GearLoss`.
        radius = float(backlash.radius) if isinstance(backlash, Backlash) else 1.0
        start = float(as_number(friction.load_ratio)) / radius if start is None else start
        return Parameter.change(GearLoss(name, radius), start, scale, unit)
    if kind == "armature":
        name, remedy = motor_of(robot, joint), "add it by robot.with_drive(joint, cj.Drive(...))"
        expected = "of a joint with an armature"
        require(motor.armature is not None, argument, kind, expected, remedy)
        return Parameter(lambda s: s.joints[name].armature, scale, value=start, unit=unit)
    body = ideal.second
    if kind == "mass":
        return Parameter(lambda s: s.bodies[body].mass, scale, value=start)
    # The last kind is "inertia": the moment of inertia about the joint's axis. The link's other
    # moments and products keep their ratios to it.
    assert isinstance(ideal, RevoluteJoint)
    axis = np.asarray(ideal.axis_second) / np.linalg.norm(ideal.axis_second)
    change = LinkInertia(body, tuple(axis.tolist()))
    start = float(change.moment(scene)) if start is None else start
    return Parameter.change(change, start, scale, unit)


def _of_gear(robot: Robot, joint: str, kind: str, start: float | None) -> Parameter:
    """Return the parameter `kind`, "play", "stiffness" or "restitution", of a hinge's gear, with
    the value `start`, by default the robot's. Raise a `ValueError` if the gear lacks it."""
    scene, argument = robot.scene, f"find[{joint!r}]"
    compliance, name = f"{joint} {COMPLIANCE}", backlash_name(joint)
    if kind == "stiffness" and compliance in scene.forces:
        return Parameter(lambda s: s.forces[compliance].stiffness, Log(), value=start)
    backlash = scene.joints.get(name)
    remedy = f'robot.with_drive({joint!r}, cj.Drive(play="0.5 deg", ...)) adds it'
    is_loose, expected = isinstance(backlash, Backlash), f"of a joint with {name!r} in the scene"
    require(is_loose, argument, kind, expected, remedy)
    assert isinstance(backlash, Backlash)
    if kind == "play":
        return Parameter(lambda s: s.joints[name].play, Log(), value=start)
    law, expected = backlash.law, f"of a joint whose flanks have a law with a {kind}"
    if kind == "restitution":
        require(hasattr(law, kind), argument, kind, expected, "leave it out")
        return Parameter(lambda s: s.joints[name].law.restitution, Bounded(0.0, 1.0), value=start)
    # The law of the flanks has a model of the stiffness, of which some have a constant stiffness.
    stiffness = getattr(getattr(law, kind, None), kind, None)
    require(stiffness is not None, argument, kind, expected, "leave it out")
    if start is None:
        start = float(as_number(stiffness) * np.asarray(backlash.radius) ** 2)
    return Parameter.change(FlankStiffness(name), start, Log(), "N m/rad")


def _measured(
    robot: Robot, log: RobotLog, driven_by: DrivenBy, following: Collection[str]
) -> Measurements:
    """Return the samples of what a run predicts: positions of joints that are not `following` the
    log, and torques of joints whose entry in `driven_by` is "angle", a motor or a servo."""
    series: dict[str, Series] = {}

    def compare(name: str, channel: Quantity, samples: Logged, unit: str) -> None:
        # Adds a series of the quantity `channel`.
        _require_unit(f"{name} of the log", samples, unit)
        remedy = "pass LogColumn(..., noise=...) for its column"
        expected = "known for what is compared with the log"
        require(samples.noise is not None, f"noise of {name!r}", None, expected, remedy)
        assert samples.noise is not None
        series[name] = Series(channel, samples.times, samples.values, samples.noise, unit, name)

    for name, samples in log.angles.items():
        if name not in following:
            hinge = is_hinge(robot, name)
            channel = JointAngle(name) if hinge else JointPosition(name)
            compare(f"{name} position", channel, samples, "rad" if hinge else "m")
    for joint, samples in log.torques.items():
        mode, name, hinge = driven_by.get(joint), drive_name(joint), is_hinge(robot, joint)
        # If a joint follows its position, a run has the torque that this takes, a multiplier. With
        # a prescribed torque, a run has no other torque to compare. The torque of a motor or servo
        # is optional: it is compared only if the log gives its noise.
        if mode == "angle":
            channel = Multiplier(name, "angle" if hinge else "distance")
            compare(f"{joint} torque", channel, samples, "N m" if hinge else "N")
        elif isinstance(mode, AbstractDriveTorque | Servo) and samples.noise is not None:
            compare(f"{joint} torque", MotorTorque(name), samples, "N m")
    remedy = "log the position of a joint that does not follow it, or the torque of one that does"
    require(bool(series), "log", [*log.angles, *log.torques], "of what a run predicts", remedy)
    return Measurements(series)
