"""Read MJCF files with MuJoCo, which resolves their defaults, frames, inertias and references.

A body of MJCF becomes a link, which is fixed to its parent if it has no joint. Several joints of a
body become a chain of joints, with links without mass between them.
"""

import math
from pathlib import Path
from types import ModuleType
from typing import TypeAlias

import numpy as np
from jaxtyping import PyTree

from . import robots
from .documents import FileLocation

Model: TypeAlias = PyTree
"""A compiled model of MuJoCo, whose classes have no annotations."""
KINDS = robots.FLOATING, robots.BALL, robots.SLIDER, "continuous"
"""Types of joints, in the order of MuJoCo's numbers for free, ball, slide and hinge."""
CONNECT, WELD, COUPLE = range(3)
"""MuJoCo's numbers of types of equality constraints."""
WITH_FILES = "geoms", "meshes", "textures", "materials", "hfields", "skins"
"""Elements that refer to other files, as attributes of MuJoCo's `MjSpec`."""
IGNORED = {
    "collision and visual shapes": "ngeom",
    "tendons": "ntendon",
    "flexible bodies": "nflex",
    "sensors": "nsensor",
    "keyframes": "nkey",
    "plugins": "nplugin",
    "mocap bodies": "nmocap",
}
"""Contents that a robot lacks, by title in messages: the attribute of a model that counts them."""


def read_mjcf(path: Path) -> robots.Content:
    location = FileLocation(str(path))
    model = _with_options_applied(_compiled(path), mujoco_package(location).mjtDisableBit)
    names = [model.body(k).name or f"body {k}" for k in range(model.nbody)]
    links = [robots.RobotLink(name, _inertial(model, k)) for k, name in enumerate(names)]
    joints: list[robots.RobotJoint] = []
    for k in range(1, model.nbody):  # without the world, body 0, which is the root link
        parent, pose = names[model.body_parentid[k]], _pose(model.body_quat[k], model.body_pos[k])
        first_joint, joint_count = model.body_jntadr[k], model.body_jntnum[k]
        if not joint_count:  # a body that is fixed to its parent; the joint's axis has no effect
            name, x_axis = f"{names[k]} {robots.FIXED}", np.array([1.0, 0.0, 0.0])
            joints.append(robots.RobotJoint(name, robots.FIXED, parent, names[k], pose, x_axis))
        # The first of several joints has the body's pose, and moves a link without mass, on which
        # the next joint is; the last joint moves the body itself.
        for j in range(first_joint, first_joint + joint_count):
            is_last = j == first_joint + joint_count - 1
            child = names[k] if is_last else f"{names[k]} after {_joint_name(model, j)}"
            if not is_last:
                links.append(robots.RobotLink(child))
            joints.append(_joint(model, j, parent, child, pose))
            parent, pose = child, np.eye(4)
    loops, followers, other_equalities = _equalities(model, names)
    joints = [joint._replace(mimic=followers.get(joint.name)) for joint in joints]
    actuators, other_actuators = _actuators(model)
    of_elements = {
        "equalities": other_equalities,
        "actuators of other kinds": other_actuators,
        "limits, damping, armature, friction and springs": _resisted(model),
        "gravity compensation": [names[k] for k in np.flatnonzero(model.body_gravcomp)],
        "nonlinear springs and dampers": _nonlinear(model),
    }
    omitted = {title: elements for title, elements in of_elements.items() if elements}
    # Contents of the robot as a whole, without names of elements.
    omitted |= {title: [] for title, number in IGNORED.items() if getattr(model, number)}
    omitted |= {"fluid": []} if model.opt.density or model.opt.viscosity else {}
    gravity = tuple(model.opt.gravity.tolist())
    return robots.Content(links, joints, omitted, loops, actuators, gravity)


def _with_options_applied(model: Model, bits: PyTree) -> Model:
    """Change the model, and return it. Set gravity, springs, dampers, dry friction and equalities
    to zero if the file's flags disable them, and add the armature and damping of each actuator of a
    joint to those of the joint. `bits`: MuJoCo's enumeration of these flags."""
    # An actuator moves at `gear` times the speed of its joint, so that the joint has gear^2 times
    # its armature and damping. Older versions of MuJoCo have neither number.
    for name in ("armature", "damping"):
        numbers = getattr(model, f"actuator_{name}", np.zeros(model.nu))
        for k in np.flatnonzero(numbers).tolist():
            joint, gear = model.actuator_trnid[k, 0], model.actuator_gear[k, 0]
            if _acts_on_joint(model, k):
                of_joints = getattr(model, f"dof_{name}")
                of_joints[model.jnt_dofadr[joint]] += gear**2 * numbers[k]

    def is_disabled(*names: str) -> bool:
        # A version of MuJoCo has either "PASSIVE" or both "SPRING" and "DAMPER".
        values = (int(getattr(bits, f"mjDSBL_{name}", 0)) for name in names)
        return any(model.opt.disableflags & value for value in values)

    # Older versions of MuJoCo have no polynomials of springs and dampers.
    none = np.zeros(0)
    for numbers, names in (
        (model.opt.gravity, ("GRAVITY",)),
        (model.jnt_stiffness, ("SPRING", "PASSIVE")),
        (getattr(model, "jnt_stiffnesspoly", none), ("SPRING", "PASSIVE")),
        (model.dof_damping, ("DAMPER", "PASSIVE")),
        (getattr(model, "dof_dampingpoly", none), ("DAMPER", "PASSIVE")),
        (model.dof_frictionloss, ("FRICTIONLOSS", "CONSTRAINT")),
        (model.eq_active0, ("EQUALITY", "CONSTRAINT")),
    ):
        if is_disabled(*names):
            numbers[:] = 0
    return model


def _acts_on_joint(model: Model, actuator: int) -> bool:
    """Return whether an actuator acts directly on a slider or hinge."""
    joint = model.actuator_trnid[actuator, 0]
    return bool(model.actuator_trntype[actuator] in (0, 1) and model.jnt_type[joint] >= 2)


def _nonlinear(model: Model) -> list[str]:
    """Return the names of joints and actuators whose springs or dampers are not linear. Only their
    linear terms are carried over. Older versions of MuJoCo have only linear ones."""
    names = [_joint_name(model, j) for j in range(model.njnt)]
    of_dofs = [names[j] for j in model.dof_jntid]
    of_actuators = [_actuator_name(model, k) for k in range(model.nu)]
    owners = {"jnt_stiffness": names, "dof_damping": of_dofs, "actuator_damping": of_actuators}
    return [
        *dict.fromkeys(
            owner
            for name, elements in owners.items()
            for owner, further in zip(elements, getattr(model, f"{name}poly", ()), strict=False)
            if np.any(further)
        )
    ]


def mujoco_package(location: FileLocation) -> ModuleType:
    try:
        import mujoco
    except ImportError as error:
        message = f"{location}: MJCF files need MuJoCo: pip install 'clearjoint[mujoco]'."
        raise ImportError(message) from error
    return mujoco


def _compiled(path: Path) -> Model:
    """Return MuJoCo's model of an MJCF file. If a file that gives all inertias does not compile, as
    when a mesh is missing, the model lacks shapes and the other elements in `WITH_FILES`."""
    location = FileLocation(str(path))
    mujoco = mujoco_package(location)
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        try:
            return spec.compile()
        except ValueError:
            # MuJoCo computes an inertia that isn't given from the body's shapes, which must then
            # not be left out. A file of a mesh, for example, may be missing.
            bodies = [body for body in spec.bodies if body.name != "world" and len(body.geoms)]
            if not all(body.explicitinertial for body in bodies):
                raise
        for elements in (getattr(spec, name, ()) for name in WITH_FILES):
            for element in [*elements]:  # a copy of the list, from which elements are deleted
                spec.delete(element)
        return spec.compile()
    except ValueError as error:
        reason = " ".join(str(error).split())
        return location.refuse(reason, "an MJCF file that MuJoCo reads", "correct the file")


def _rotation(quaternion: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return robots.rounded(Rotation.from_quat(quaternion, scalar_first=True).as_matrix())


def _pose(quaternion: np.ndarray, position: np.ndarray) -> np.ndarray:
    return robots.pose_of(_rotation(quaternion), position)


def _inertial(model: Model, body: int) -> robots.Inertial | None:
    if body == 0 or not model.body_mass[body] > 0.0:
        return None
    axes = _rotation(model.body_iquat[body])
    tensor = axes @ np.diag(model.body_inertia[body]) @ axes.T
    return robots.Inertial(float(model.body_mass[body]), model.body_ipos[body].copy(), tensor)


def _joint_name(model: Model, joint: int) -> str:
    return model.joint(joint).name or f"joint {joint}"


def _actuator_name(model: Model, actuator: int) -> str:
    return model.actuator(actuator).name or f"actuator {actuator}"


def _joint(model: Model, j: int, parent: str, child: str, pose: np.ndarray) -> robots.RobotJoint:
    """Return the joint with number `j` in the model, from the link `parent` to the link `child`.
    `pose`: (4, 4) m, of the child in the parent's frame while the joint is at MuJoCo's `qpos0`."""
    name, kind = _joint_name(model, j), KINDS[model.jnt_type[j]]
    axis, point = model.jnt_axis[j].copy(), model.jnt_pos[j].copy()
    # Limits, springs, damping and so on of these joints are left out (see `_resisted`).
    if kind in (robots.FLOATING, robots.BALL):
        return robots.RobotJoint(name, kind, parent, child, pose, axis, point=point)
    # Indices of the joint's position and speed in MuJoCo's arrays of these.
    position_index, speed_index = model.jnt_qposadr[j], model.jnt_dofadr[j]
    _, effort = _range(model.jnt_actfrcrange[j], model.jnt_actfrclimited[j])
    lower, upper = _range(model.jnt_range[j], model.jnt_limited[j])
    has_limits = bool(model.jnt_limited[j] or model.jnt_actfrclimited[j])
    # In MuJoCo, `pose` is reached at the joint's position qpos0; in a `RobotJoint`, at zero.
    return robots.RobotJoint(
        name,
        kind,
        parent,
        child,
        pose @ _motion(kind, axis, point, -float(model.qpos0[position_index])),
        axis,
        robots.JointLimits(lower, upper, effort) if has_limits else None,
        point=point,
        friction=float(model.dof_frictionloss[speed_index]),
        damping=float(model.dof_damping[speed_index]),
        stiffness=float(model.jnt_stiffness[j]),
        rest=float(model.qpos_spring[position_index]),
        armature=float(model.dof_armature[speed_index]),
    )


def _range(ends: np.ndarray, is_limited: bool) -> tuple[float, float]:
    lower, upper = ends.tolist() if is_limited else (-math.inf, math.inf)
    return lower, upper


def _motion(kind: str, axis: np.ndarray, point: np.ndarray, position: float) -> np.ndarray:
    """Return the pose, (4, 4) m, of a body at a joint's `position`, rad or m, in the frame that the
    body has at zero; the joint's `axis` and `point`, (3,) each, are in this frame too."""
    from scipy.spatial.transform import Rotation

    if kind == robots.SLIDER:
        return robots.pose_of(np.eye(3), axis * position)
    if not position:
        return np.eye(4)
    rotation = Rotation.from_rotvec(axis * position).as_matrix()
    return robots.pose_of(rotation, point - rotation @ point)


def _equalities(
    model: Model, names: list[str]
) -> tuple[tuple[robots.LoopJoint, ...], dict[str, robots.Mimic], list[str]]:
    """Return the constraints that close loops, the `Mimic` of each following joint by name, and the
    names of all other constraints. `names`: of the bodies, in the order of the model."""
    loops: list[robots.LoopJoint] = []
    followers: dict[str, robots.Mimic] = {}
    others: list[str] = []
    for k in range(model.neq):
        name, kind, data = model.eq(k).name or f"equality {k}", model.eq_type[k], model.eq_data[k]
        ids = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])  # of two joints, bodies or sites
        if kind == COUPLE and model.eq_active0[k]:
            follower = _joint_name(model, ids[0])
            # A joint can follow one leader only: a second coupling is among the `others`.
            if follower not in followers:
                followers[follower] = _mimic(model, *ids, data[:5])
                continue
        if kind not in (CONNECT, WELD) or not model.eq_active0[k]:
            others.append(name)
            continue
        # For two bodies, `eq_data` has a point in each of them (connect) or, from entry 3 on, the
        # pose of the second relative to the first (weld). A site has a pose in its body.
        frames = [np.eye(4), np.eye(4)]
        body_type = 1  # MuJoCo's number of bodies, as a type of objects
        if model.site_bodyid.size and model.eq_objtype[k] != body_type:  # two sites
            frames = [_pose(model.site_quat[site], model.site_pos[site]) for site in ids]
            ids = tuple(int(model.site_bodyid[site]) for site in ids)
        elif kind == CONNECT:
            frames[0][:3, 3], frames[1][:3, 3] = data[:3], data[3:6]
        else:
            frames[0] = _pose(data[6:10], data[3:6])
        first_link, second_link = (names[body] for body in ids)
        of_loop = robots.BALL if kind == CONNECT else robots.FIXED
        loops.append(robots.LoopJoint(name, of_loop, first_link, second_link, frames[0], frames[1]))
    return tuple(loops), followers, others


def _mimic(model: Model, follower: int, leader: int, coefficients: np.ndarray) -> robots.Mimic:
    """Return how the joint number `follower` follows the joint number `leader`, negative for none.
    In MJCF, the follower's q - qpos0 is a polynomial of the leader's q - qpos0, with `coefficients`
    from the constant on; a `Mimic` has the polynomial of the positions q themselves."""
    start = model.qpos0[model.jnt_qposadr[follower]]
    if leader < 0:
        return robots.Mimic(None, (float(start + coefficients[0]),))
    shift = np.polynomial.Polynomial([-model.qpos0[model.jnt_qposadr[leader]], 1.0])
    polynomial = (np.polynomial.Polynomial(coefficients)(shift) + start).trim()
    return robots.Mimic(_joint_name(model, leader), tuple(polynomial.coef.tolist()))


def _actuators(model: Model) -> tuple[dict[str, robots.Actuator], list[str]]:
    """Return the actuators that `robots.Actuator` can describe, by name, and the others' names."""
    actuators: dict[str, robots.Actuator] = {}
    others: list[str] = []
    for k in range(model.nu):
        name, (target, _) = _actuator_name(model, k), model.actuator_trnid[k]
        # An `Actuator` acts on a slider or hinge, with a fixed gain, an affine bias (type 1) or
        # none (type 0), and no activation state or delay.
        is_affine = model.actuator_gaintype[k] == 0 and model.actuator_biastype[k] in (0, 1)
        is_delayed = bool(getattr(model, "actuator_delay", np.zeros(model.nu))[k])
        is_static = model.actuator_dyntype[k] == 0 and not is_delayed
        if not (_acts_on_joint(model, k) and is_affine and is_static):
            others.append(name)
            continue
        bias = model.actuator_biasprm[k, :3] * (model.actuator_biastype[k] == 1)
        actuators[name] = robots.Actuator(
            _joint_name(model, target),
            float(model.actuator_gear[k, 0]),
            float(model.actuator_gainprm[k, 0]),
            tuple(bias.tolist()),
            _range(model.actuator_ctrlrange[k], model.actuator_ctrllimited[k]),
            _range(model.actuator_forcerange[k], model.actuator_forcelimited[k]),
        )
    return actuators, others


def _resisted(model: Model) -> list[str]:
    """Return the names of the balls and free joints that have limits, springs, damping, friction or
    armature in the file, which a `Robot` has for hinges and sliders only."""
    resisting = model.dof_damping + model.dof_frictionloss + model.dof_armature
    names = []
    for j in range(model.njnt):
        resists = resisting[model.dof_jntid == j].any()
        if model.jnt_type[j] < 2 and (model.jnt_limited[j] or model.jnt_stiffness[j] or resists):
            names.append(_joint_name(model, j))
    return names
