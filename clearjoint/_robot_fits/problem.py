"""The scene, the parameters and the measurements of the fit of a robot to its log."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, get_args

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from typing_extensions import override

from .._fields.checks import nearest, require
from .._math.vectors import Scalar
from .._measurements.robot_logs import Logged, RobotLog
from .._measurements.series import Measurements, Series
from .._model.bodies import State
from .._model.clearance_joints.backlash import Backlash
from .._model.contact.friction import RegularisedCoulomb
from .._model.drives.drivers import DriveTorque, PrescribedAngle, PrescribedTranslation
from .._model.drives.functions_of_time import PiecewiseConstant, Spline
from .._model.forces import TorsionalSpring
from .._model.joints.ideal import PrismaticJoint, RevoluteJoint
from .._model.joints.joint_friction import JointFriction
from .._model.scene import Scene
from .._parametrisation.parameter import Bounded, Linear, Log, Parameter
from .._parametrisation.paths import set_value
from .._scene_files.documents import FileLocation
from .._scene_files.reading import number_of_text
from .._scene_files.robot import Robot
from ..quantities.base import AbstractQuantity, Instant, Quantity, require_known
from ..quantities.joints import JointAngle, Multiplier

Kind = Literal["play", "stiffness", "restitution", "friction", "damping", "inertia", "mass"]
"""What a fit finds of a joint."""
UNITS: dict[Kind, str] = {
    "play": "rad",
    "stiffness": "N m/rad",
    "restitution": "1",
    "friction": "N m",
    "damping": "N m s/rad",
    "inertia": "kg m^2",
    "mass": "kg",
}
Driving = Literal["angle", "torque", "held torque"]
"""How a joint is driven, see `fit_robot`."""
Start: TypeAlias = float | str | None
"""Number or text with a unit from which a fit starts."""
Find: TypeAlias = Mapping[str, Mapping[Kind, Start] | Sequence[Kind]]
"""What to find, by the name of the joint."""
COULOMB = RegularisedCoulomb(1.0, regularisation_speed=3e-4)
"""Law of a friction that the robot lacks, over its load. Steps are several times as long as with
bristles, whose stiffness limits them at speed; a loaded joint creeps by less than 3e-4 rad/s."""
SHARE = 0.1
"""Share of the largest logged torque with which the fit of a friction or a damping starts, if
neither the user nor the robot has one."""


class JointPosition(AbstractQuantity):
    """Distance, m, of the points of a slider along its axis."""

    joint: str = eqx.field(static=True)
    unit = "m"

    @override
    def check(self, scene: Scene) -> None:
        sliders = [n for n, joint in scene.joints.items() if isinstance(joint, PrismaticJoint)]
        require_known("joint", self.joint, sliders)

    @override
    def __call__(self, now: Instant) -> Scalar:
        joint = now.scene.joints[self.joint]
        assert isinstance(joint, PrismaticJoint)
        return joint.relative_distance(now.motions).value


@dataclass(frozen=True)
class LinkInertia:
    """Function that scales a body's inertia so that its moment about an axis through the centre of
    mass has a given value, kg m^2."""

    body: str
    axis: tuple[float, float, float]

    def moment(self, scene: Scene) -> Scalar:
        inertia, axis = jnp.asarray(scene.bodies[self.body].inertia), jnp.asarray(self.axis)
        return axis @ (inertia * axis if inertia.ndim == 1 else inertia @ axis)

    def __call__(self, scene: Scene, state: State, value: Scalar) -> tuple[Scene, State]:
        inertia = scene.bodies[self.body].inertia * (value / self.moment(scene))
        return set_value(scene, lambda s: s.bodies[self.body].inertia, inertia), state


@dataclass(frozen=True)
class FlankStiffness:
    """Function that gives the flanks of a backlash a torsional stiffness, N m/rad."""

    joint: str

    def __call__(self, scene: Scene, state: State, value: Scalar) -> tuple[Scene, State]:
        stiffness = value / scene.joints[self.joint].radius ** 2  # pyright: ignore
        return set_value(scene, lambda s: s.joints[self.joint].law.stiffness, stiffness), state


@dataclass(frozen=True)
class StartOfJoint:
    """Function that gives a joint a position, or with `of_speed` a speed, at the start."""

    robot: Robot
    joint: str
    of_speed: bool

    def __call__(self, scene: Scene, state: State, value: Scalar) -> tuple[Scene, State]:
        start = {self.joint: value}
        q, qd = (None, start) if self.of_speed else (start, None)
        return scene, self.robot.moved(state, q, qd)


@dataclass(frozen=True)
class RobotProblem:
    """A driven robot at the start of its log, its parameters, and what the log measures.

    - `scene`, `state`: of the driven robot at the start.
    - `subjects`: the joint of each parameter, and what it is of it, such as "play".
    """

    robot: Robot
    log: RobotLog
    drive: Mapping[str, Driving]
    scene: Scene
    state: State
    parameters: dict[str, Parameter]
    subjects: dict[str, tuple[str, str]]
    measurements: Measurements


def drive_name(joint: str) -> str:
    """Return the name of the element of the scene that drives a joint."""
    return f"{joint} drive"


def backlash_name(joint: str) -> str:
    """Return the name of the backlash of a joint in the scene."""
    return f"{joint} backlash"


def robot_problem(
    robot: Robot, log: RobotLog, find: Find, drive: Mapping[str, Driving]
) -> RobotProblem:
    """Return the problem of a fit; raise a `ValueError` for what does not fit together."""
    for argument, part in (
        ("find", find),
        ("drive", drive),
        ("log.angles", log.angles),
        ("log.torques", log.torques),
    ):
        for joint in part:
            expected = f"one of the robot's joints {', '.join(robot.joints)}"
            remedy = nearest(joint, robot.joints, "leave it out")
            require(joint in robot.joints, argument, joint, expected, remedy)
    positions = {joint: _smoothed(robot, joint, s) for joint, s in log.angles.items()}
    scene = _driven(robot, log, drive, positions)
    parameters: dict[str, Parameter] = {}
    subjects: dict[str, tuple[str, str]] = {}
    for joint, kinds in find.items():
        starts = kinds if isinstance(kinds, Mapping) else dict.fromkeys(kinds)
        for kind, start in starts.items():
            expected, remedy = f"one of {', '.join(UNITS)}", nearest(kind, UNITS, "leave it out")
            require(kind in UNITS, f"find[{joint!r}]", kind, expected, remedy)
            if isinstance(start, str):
                location = FileLocation("find", (joint, kind))
                start = number_of_text(start, _unit(robot, joint, kind), location)
            name = f"{joint} {kind}"
            scene = _with_element(scene, robot, joint, kind, _guess(log, positions, joint, kind))
            parameters[name] = _parameter(scene, robot, joint, kind, start)
            subjects[name] = joint, kind
    # A driven joint begins where its table does. The start of the others is known as accurately as
    # a single sample, so that it is a parameter.
    q = {joint: float(spline.values[0]) for joint, spline in positions.items()}
    qd = {joint: float(spline.rates[0]) for joint, spline in positions.items()}
    for joint, samples in log.angles.items():
        if drive.get(joint) == "angle":
            continue
        unit = "rad" if is_hinge(robot, joint) else "m"
        for of_speed, start in ((False, q[joint]), (True, qd[joint])):
            kind = "start speed" if of_speed else "start position"
            scale = Linear(unit=(100.0 if of_speed else 1.0) * (samples.noise or 1e-3))
            change = StartOfJoint(robot, joint, of_speed)
            suffix = "/s" if of_speed else ""
            name = f"{joint} {kind}"
            parameters[name] = Parameter.change(change, start, scale, unit=unit + suffix)
            subjects[name] = joint, kind
    measurements = _measured(robot, log, drive)
    state = robot.state(q, qd)
    return RobotProblem(robot, log, drive, scene, state, parameters, subjects, measurements)


def is_hinge(robot: Robot, joint: str) -> bool:
    return not isinstance(robot.scene.joints[joint], PrismaticJoint)


def _unit(robot: Robot, joint: str, kind: Kind) -> str:
    if is_hinge(robot, joint):
        return UNITS[kind]
    return {"friction": "N", "mass": "kg"}.get(kind, "")


def _smoothed(robot: Robot, joint: str, samples: Logged) -> Spline:
    """Return a cubic spline through samples or, if their noise is known, a smoothing spline of few
    pieces that misses them by their noise (P. Dierckx, *Curve and Surface Fitting with Splines*,
    1993)."""
    from scipy.interpolate import UnivariateSpline

    hinge = is_hinge(robot, joint)
    unit = "rad" if hinge else "m"
    remedy = "correct the unit of its column"
    require(samples.unit in (unit, None), f"log.angles[{joint!r}]", samples.unit, unit, remedy)
    values = np.unwrap(samples.values) if hinge else samples.values
    if samples.noise is None or len(values) < 5:
        return Spline.through(samples.times, values)
    weights = np.full(len(values), 1.0 / samples.noise)
    spline = UnivariateSpline(samples.times, values, weights, k=3, s=len(values))
    knots = spline.get_knots()
    return Spline(knots, spline(knots), spline.derivative()(knots))


def _driven(
    robot: Robot, log: RobotLog, drive: Mapping[str, Driving], positions: Mapping[str, Spline]
) -> Scene:
    """Return the robot's scene with an element for each joint that is driven."""
    joints, forces = dict(robot.scene.joints), dict(robot.scene.forces)
    for joint, mode in drive.items():
        argument, modes = f"drive[{joint!r}]", get_args(Driving)
        require(mode in modes, argument, mode, f"one of {', '.join(modes)}", "name one of them")
        part = "angles" if mode == "angle" else "torques"
        is_logged, expected = joint in getattr(log, part), f"what the log has in `{part}`"
        remedy = f"pass {part}={{{joint!r}: column}} to RobotLog.read"
        require(is_logged, argument, mode, expected, remedy)
        name, ideal = drive_name(joint), joints[joint]
        taken = name in joints or name in forces
        require(not taken, argument, name, "a name that is free", "rename that element")
        if mode == "angle" and isinstance(ideal, RevoluteJoint):
            ends = ideal.first, ideal.second, ideal.axis_first
            joints[name] = PrescribedAngle(*ends, positions[joint])
        elif mode == "angle" and isinstance(ideal, PrismaticJoint):
            ends = ideal.first, ideal.second, ideal.point_first, ideal.point_second
            joints[name] = PrescribedTranslation(*ends, ideal.axis, positions[joint])
        else:
            remedy = "drive it by its angle, or add the load to the robot's scene"
            kind = type(ideal).__name__
            require(isinstance(ideal, RevoluteJoint), argument, kind, "of an ideal hinge", remedy)
            assert isinstance(ideal, RevoluteJoint)
            times, torques, _, unit = log.torques[joint]
            expected, remedy = "N m", "correct the unit of its column"
            require(unit in ("N m", None), f"log.torques[{joint!r}]", unit, expected, remedy)
            make = PiecewiseConstant if mode == "held torque" else Spline.through
            ends = ideal.first, ideal.second, ideal.axis_first
            forces[name] = DriveTorque(*ends, make(times, torques))
    return replace(robot.scene, joints=joints, forces=forces)


def _guess(log: RobotLog, positions: Mapping[str, Spline], joint: str, kind: Kind) -> float | None:
    """Return a start of a friction or damping that the robot lacks, ``None`` without torques."""
    if joint not in log.torques:
        return None
    torque = SHARE * float(np.abs(log.torques[joint].values).max())
    if kind != "damping" or joint not in positions:
        return torque
    return torque / max(float(np.abs(positions[joint].rates).max()), 1e-12)


def _with_element(scene: Scene, robot: Robot, joint: str, kind: Kind, start: float | None) -> Scene:
    """Return the scene with friction or damping in a hinge that has none."""
    name = f"{joint} {kind}"
    joints, forces = dict(scene.joints), dict(scene.forces)
    hinge = robot.scene.joints[joint]
    lacks = name not in joints and name not in forces and f"{joint} spring" not in forces
    if kind not in ("friction", "damping") or not isinstance(hinge, RevoluteJoint) or not lacks:
        return scene
    start = 1.0 if start is None else start
    ends = hinge.first, hinge.second
    if kind == "friction":
        joints[name] = JointFriction(*ends, COULOMB, start, hinge.axis_first, radius=1.0)
    else:
        forces[name] = TorsionalSpring(*ends, hinge.axis_first, 0.0, start)
    return replace(scene, joints=joints, forces=forces)


def _parameter(
    scene: Scene, robot: Robot, joint: str, kind: Kind, start: float | None
) -> Parameter:
    """Return the parameter of a joint; raise a `ValueError` if the robot has no such number."""
    hinge = scene.joints[joint]
    argument, has = f"find[{joint!r}]", {*scene.joints, *scene.forces}

    def need(name: str, remedy: str) -> None:
        require(name in has, argument, kind, f"of a joint with an element {name!r}", remedy)

    if kind in ("play", "stiffness", "restitution"):
        name = backlash_name(joint)
        need(name, f'pass play={{{joint!r}: {{"backlash": "0.5 deg"}}}} to load_robot')
        backlash = scene.joints[name]
        assert isinstance(backlash, Backlash)
        if kind == "play":
            return Parameter(lambda s: s.joints[name].play, Log(), value=start)
        law = backlash.law
        if kind == "restitution":
            expected = "of a joint whose flanks have a law with a restitution"
            require(hasattr(law, "restitution"), argument, kind, expected, "leave it out")
            scale = Bounded(0.0, 1.0)
            return Parameter(lambda s: s.joints[name].law.restitution, scale, value=start)
        present = float(backlash.law.stiffness * backlash.radius**2)  # pyright: ignore
        start = present if start is None else start
        return Parameter.change(FlankStiffness(name), start, Log(), "N m/rad")
    if kind == "friction":
        name = f"{joint} friction"
        need(name, "pass a robot whose file has a friction of this joint")
        unit = _unit(robot, joint, kind)
        return Parameter(lambda s: s.joints[name].load, Log(), value=start, unit=unit)
    if kind == "damping":
        name = f"{joint} spring" if f"{joint} spring" in has else f"{joint} damping"
        need(name, "leave it out: a slider without damping has none to find")
        return Parameter(lambda s: s.forces[name].damping, Log(), value=start)
    body = hinge.pair()[1]  # pyright: ignore
    if kind == "mass":
        return Parameter(lambda s: s.bodies[body].mass, Log(), value=start)
    expected = "of a hinge"
    require(isinstance(hinge, RevoluteJoint), argument, kind, expected, "take its mass")
    assert isinstance(hinge, RevoluteJoint)
    axis = np.asarray(hinge.axis_second) / np.linalg.norm(hinge.axis_second)
    change = LinkInertia(body, tuple(axis.tolist()))
    start = float(change.moment(scene)) if start is None else start
    return Parameter.change(change, start, Log(), "kg m^2")


def _measured(robot: Robot, log: RobotLog, drive: Mapping[str, Driving]) -> Measurements:
    """Return what a run predicts: positions of joints that don't follow the log, and the torques
    that make others follow it."""
    channels: dict[str, tuple[Quantity, Logged, str]] = {}
    for joint, samples in log.angles.items():
        if drive.get(joint) != "angle":
            hinge = is_hinge(robot, joint)
            channel = JointAngle(joint) if hinge else JointPosition(joint)
            channels[f"{joint} position"] = channel, samples, "rad" if hinge else "m"
    for joint, samples in log.torques.items():
        if drive.get(joint) == "angle":
            hinge = is_hinge(robot, joint)
            channel = Multiplier(drive_name(joint), "angle" if hinge else "distance")
            channels[f"{joint} torque"] = channel, samples, "N m" if hinge else "N"
    remedy = (
        "log the angle of a joint that is not driven by its angle, or the torque of one that is"
    )
    require(bool(channels), "log", [*log.angles, *log.torques], "of what a run predicts", remedy)
    series = {}
    for name, (channel, samples, unit) in channels.items():
        remedy = "pass LogColumn(..., noise=...) for its column"
        expected = "known for what is compared with the log"
        require(samples.noise is not None, f"noise of {name!r}", None, expected, remedy)
        assert samples.noise is not None
        expected, remedy = f"in {unit}", "correct the unit of its column"
        require(samples.unit in (unit, None), f"{name!r} of `log`", samples.unit, expected, remedy)
        times, values = samples.times, samples.values
        series[name] = Series(channel, times, values, samples.noise, unit, name)
    return Measurements(series)
