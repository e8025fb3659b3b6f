"""Symmetry transformations of any scene: turned or mirrored, in other units, or with reversed axes
of joints."""

import copy
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import clearjoint as cj

SECOND = ("second", "journal", "ball", "pin", "slider")
ABOUT_AXIS = (
    *(cj.PrescribedRotation, cj.PrescribedAngle, cj.DriveTorque, cj.Motor, cj.Servo, cj.Encoder),
    *(cj.TorsionalSpring, cj.GearJoint, cj.GearBacklash, cj.Backlash, cj.ScrewJoint),
)
"""Elements whose axis tells the sense of a rotation: a mirror reverses it."""
Maps = Mapping[str, np.ndarray]


def with_fields(element: Any, **values: Any) -> Any:
    """The element with other values of its fields."""
    changed = copy.copy(element)
    for name, value in values.items():
        object.__setattr__(changed, name, value)
    return changed


def scene_with(scene: cj.Scene, change: Callable[[Any], Any], **parts: Any) -> cj.Scene:
    """The scene with every joint and force changed."""
    bodies, gravity = parts.get("bodies", scene.bodies), parts.get("gravity", scene.gravity)
    joints, forces = (
        {name: change(element) for name, element in family.items()}
        for family in (scene.joints, scene.forces)
    )
    return cj.Scene(bodies, joints, forces, gravity)


def matrix(euler: Any) -> np.ndarray:
    return Rotation.from_quat(np.asarray(euler), scalar_first=True).as_matrix()


def euler(rotation: np.ndarray) -> np.ndarray:
    return Rotation.from_matrix(rotation).as_quat(scalar_first=True)


def turned(scene: cj.Scene, maps: Maps, moved: np.ndarray) -> cj.Scene:
    """Everything on the ground, and on each body in its own axes, mapped by an orthogonal matrix by
    name, all with the same determinant; points of the ground are moved then."""
    bodies = {
        name: cj.Body(body.mass, maps[name] @ inertia_matrix(body) @ maps[name].T)
        for name, body in scene.bodies.items()
    }
    gravity = maps["ground"] @ np.asarray(scene.gravity)
    return scene_with(
        scene, lambda e: turned_element(e, maps, moved), bodies=bodies, gravity=gravity
    )


def inertia_matrix(body: cj.Body) -> np.ndarray:
    inertia = np.asarray(body.inertia)
    return np.diag(inertia) if inertia.ndim == 1 else inertia


def turned_state(
    state: cj.State, maps: Maps, moved: np.ndarray, drift: np.ndarray | float = 0.0
) -> cj.State:
    """Where the bodies of the turned scene are, of one state or many, with a velocity `drift`, m/s,
    added to that of all bodies."""
    ground = maps["ground"]
    flipped = np.linalg.det(ground)
    return cj.State(
        {
            name: cj.BodyState(
                np.asarray(body.position) @ ground.T + moved,
                euler(ground @ matrix(body.orientation) @ maps[name].T),
                np.asarray(body.velocity) @ ground.T + drift,
                flipped * np.asarray(body.spin) @ maps[name].T,
            )
            for name, body in state.bodies.items()
        }
    )


def turned_element(element: Any, maps: Maps, moved: np.ndarray) -> Any:
    if isinstance(element, cj.LubricatedJoint):
        return with_fields(element, dry=turned_element(element.dry, maps, moved))
    if isinstance(element, cj.Servo) and element.encoder is not None:
        encoder = turned_element(element.encoder, maps, moved)
        servo = turned_element(with_fields(element, encoder=None), maps, moved)
        return with_fields(servo, encoder=encoder)
    flipped = round(np.linalg.det(maps["ground"]))
    if isinstance(element, cj.AppliedLoad):
        own, ground = maps[element.body], maps["ground"]
        return with_fields(
            element,
            force=turned_load(element.force, ground),
            torque=turned_load(element.torque, flipped * ground),
            point=own @ np.asarray(element.point) + (element.body == "ground") * moved,
        )
    first, second = sides(element)
    sense = flipped if isinstance(element, ABOUT_AXIS) else 1
    changes: dict[str, Any] = {}
    for field in fields(element):
        value = getattr(element, field.name)
        if value is None or np.shape(value) not in ((3,), (4,)):
            continue
        body = side_of(element, field.name)
        if np.shape(value) == (4,):
            changes[field.name] = turned_orientation(element, field.name, maps, value, flipped)
        elif re.search("point", field.name):
            changes[field.name] = maps[body] @ np.asarray(value) + (body == "ground") * moved
        elif re.search("axis|normal", field.name):
            changes[field.name] = sense * maps[body] @ np.asarray(value)
    after = with_fields(element, **changes)
    pair = maps[first], maps[second]
    if isinstance(element, cj.Backlash):
        return with_fields(after, middle=element.middle + new_zero(element, after, *pair))
    if isinstance(element, cj.ScrewJoint):
        # The thread goes on where the angle is counted from elsewhere.
        lead = flipped * element.lead
        advance = lead * new_zero(element, after, *pair) / (2.0 * math.pi)
        along = after.axis_second / np.linalg.norm(after.axis_second)
        return with_fields(after, lead=lead, point_second=after.point_second + advance * along)
    if isinstance(element, cj.GearBacklash):
        ratio = element.teeth_second / element.teeth_first
        starts = [
            new_start(getattr(element, name), getattr(after, name), own)
            for name, own in zip(("axis_first", "axis_second"), pair, strict=True)
        ]
        return with_fields(after, phase=element.phase + starts[0] + ratio * starts[1])
    return after


def turned_load(load: Any, own_map: np.ndarray) -> Any:
    if hasattr(load, "values"):
        columns = {name: getattr(load, name, None) for name in ("values", "rates")}
        given = {name: table for name, table in columns.items() if table is not None}
        return with_fields(load, **{name: t @ own_map.T for name, t in given.items()})
    return own_map @ np.asarray([float(part) for part in load])


def sides(element: Any) -> tuple[str, str]:
    """Names of the bodies whose axes the element's vectors refer to."""
    if isinstance(element, cj.GearJoint):
        return element.carrier, element.carrier
    names = element.body_names()
    return names[0], names[1]


def side_of(element: Any, field: str) -> str:
    first, second = sides(element)
    if isinstance(element, cj.LineInPlaneJoint) and field == "axis":
        return second
    return second if re.search("|".join(SECOND), field) else first


def turned_orientation(
    element: Any, field: str, maps: Maps, value: Any, flipped: int
) -> np.ndarray:
    if isinstance(element, cj.Bushing):  # Along its axes nothing changes.
        return euler(flipped * maps[side_of(element, field)] @ matrix(value))
    if isinstance(element, cj.GearJoint):
        gear = element.first if field == "orientation_first" else element.second
        return euler(maps[element.carrier] @ matrix(value) @ maps[gear].T)
    first, second = element.body_names()
    return euler(maps[first] @ matrix(value) @ maps[second].T)


def shortest(axis_first: Any, axis_second: Any) -> np.ndarray:
    """The shortest rotation that makes the second axis parallel to the first."""
    a, b = (np.asarray(v) / np.linalg.norm(v) for v in (axis_first, axis_second))
    b = b if a @ b >= 0.0 else -b
    cross, halves = np.cross(b, a), 1.0 + a @ b
    skew = np.cross(np.eye(3), cross)
    return np.eye(3) + skew + skew @ skew / halves


def new_zero(before: Any, after: Any, first: np.ndarray, second: np.ndarray) -> float:
    """The angle that a joint's angle of zero has become, rad."""
    old = first @ shortest(before.axis_first, before.axis_second) @ second.T
    start = transverse(after.axis_first)
    mark = old @ shortest(after.axis_first, after.axis_second).T @ start
    axis = np.asarray(after.axis_first) / np.linalg.norm(after.axis_first)
    return float(np.arctan2(axis @ np.cross(start, mark), start @ mark))


def new_start(before: Any, after: Any, own: np.ndarray) -> float:
    """The angle from where angles were counted to where they are now, rad."""
    axis = np.asarray(after) / np.linalg.norm(after)
    old, new = own @ transverse(before), transverse(after)
    return float(np.arctan2(axis @ np.cross(old, new), old @ new))


def transverse(axis: Any) -> np.ndarray:
    """The direction across an axis from which the gears' angles are counted."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    return np.array([1.0 + sign * x * x * a, sign * x * y * a, -sign * x])


UNITS = {
    "kg": (0, 1, 0),
    "m": (1, 0, 0),
    "s": (0, 0, 1),
    "N": (1, 1, -2),
    "Pa": (-1, 1, -2),
    "rad": (0, 0, 0),
    "Hz": (0, 0, -1),
    "1": (0, 0, 0),
}
"""Powers of metre, kilogram and second."""
Scale = tuple[float, float, float]


def factor(unit: str, scale: Scale, powers: Mapping[str, float]) -> float:
    """What a number with a unit is multiplied by in units smaller by metre, kilogram, second.

    `powers` are those that a law has for the letters in an exponent of its units.
    """
    above, _, below = re.sub("[()]", "", unit).partition("/")
    found = 1.0
    for part, sense in ((above, 1.0), (below, -1.0)):
        for single in part.split():
            name, _, power = single.partition("^")
            exponent = float(eval(power or "1", {}, dict(powers)))  # noqa: S307
            for size, basic in zip(scale, UNITS[name], strict=True):
                found *= size ** (sense * exponent * basic)
    return found


def in_units(scene: cj.Scene, scale: Scale) -> cj.Scene:
    """The scene in units that are so many times smaller, as the fields' declared units demand."""
    metre, kilogram, second = scale
    bodies = {
        name: cj.Body(kilogram * body.mass, kilogram * metre**2 * np.asarray(body.inertia))
        for name, body in scene.bodies.items()
    }
    gravity = None if scene.gravity is None else metre / second**2 * np.asarray(scene.gravity)
    return scene_with(scene, lambda e: in_other_units(e, scale), bodies=bodies, gravity=gravity)


def in_other_units(element: Any, scale: Scale) -> Any:
    powers = {"n": getattr(element, "exponent", 1.5), "m": getattr(element, "damping_exponent", 0)}
    changes = {}
    for field in fields(element):
        value, unit = getattr(element, field.name), field.metadata.get("unit")
        if field.metadata.get("static") or value is None or isinstance(value, str | bool):
            continue
        if unit is None:
            given = isinstance(value, cj.laws.GivenStiffness)
            changes[field.name] = (
                cj.laws.GivenStiffness(value.stiffness * factor("N/m^n", scale, powers))
                if given
                else in_other_units(value, scale)
            )
        elif unit != "1" or hasattr(value, "body_names"):
            times = factor(unit, scale, powers)
            changes[field.name] = scaled_function(value, times, scale[2])
    return with_fields(element, **changes)


def scaled_function(value: Any, times: float, second: float) -> Any:
    """A number, or a function of time, that is so many times larger, in smaller seconds."""
    if isinstance(value, tuple):
        return tuple(scaled_function(part, times, second) for part in value)
    if isinstance(value, cj.Polynomial):
        coefficients = np.asarray(value.coefficients)
        return cj.Polynomial(times * coefficients / second ** np.arange(len(coefficients)))
    if not hasattr(value, "values"):
        return times * np.asarray(value)
    changes = {"times": second * value.times, "values": times * value.values}
    if hasattr(value, "rates"):
        changes["rates"] = times / second * value.rates
    return with_fields(value, **changes)


def state_in_units(state: cj.State, scale: Scale) -> cj.State:
    metre, _, second = scale
    return cj.State(
        {
            name: cj.BodyState(
                metre * np.asarray(body.position),
                body.orientation,
                metre / second * np.asarray(body.velocity),
                np.asarray(body.spin) / second,
            )
            for name, body in state.bodies.items()
        }
    )


REVERSIBLE: dict[type, tuple[tuple[str, ...], ...]] = {
    cj.ClearanceJoint: (("journal_axis",), ("bearing_axis",)),
    cj.MasslessLink: (("journal_axis",), ("bearing_axis",)),
    cj.SliderInGuide: (("slider_axis",), ("guide_normal", "slider_normal")),
    cj.PinInSlot: (("slot_axis",), ("slot_normal",)),
    cj.RevoluteJoint: (("axis_first", "axis_second"),),
    cj.CylindricalJoint: (("axis_first", "axis_second"),),
    cj.PlanarJoint: (("axis_first", "axis_second"),),
    cj.ScrewJoint: (("axis_first", "axis_second"),),
    cj.UniversalJoint: (("axis_first",), ("axis_second",)),
    cj.PrismaticJoint: (("axis",),),
    cj.InlineJoint: (("axis",),),
    cj.PointInPlaneJoint: (("normal",),),
    cj.LineInPlaneJoint: (("normal",), ("axis",)),
    cj.Backlash: (("axis_first", "axis_second", "middle"),),
}
"""Fields that, negated together, describe the same joint: the bases V and W, the corners of a
slider, the walls of a slot and the flanks of a backlash are exchanged."""


def is_reversible(element: Any, choice: int) -> bool:
    """Whether the choice reverses any axis of the element."""
    if isinstance(element, cj.LubricatedJoint):
        return is_reversible(element.dry, choice)
    return choice < 1 << len(REVERSIBLE.get(type(element), ()))


def reversed_axes(element: Any, choice: int) -> Any:
    """The same joint with its axes reversed, or those that the bits of a choice tell."""
    if isinstance(element, cj.LubricatedJoint):
        return with_fields(element, dry=reversed_axes(element.dry, choice))
    changes = {}
    for k, together in enumerate(REVERSIBLE.get(type(element), ())):
        if choice >> k & 1:
            changes |= {name: -np.asarray(getattr(element, name)) for name in together}
    return with_fields(element, **changes)


def renamed(scene: cj.Scene, names: Mapping[str, str]) -> cj.Scene:
    """The scene with other names of its bodies; a body that becomes the ground is left out."""
    bodies = {names[name]: body for name, body in scene.bodies.items() if names[name] != "ground"}
    return scene_with(scene, lambda e: with_names(e, names), bodies=bodies)


def with_names(element: Any, names: Mapping[str, str]) -> Any:
    """The element between bodies of other names."""
    if isinstance(element, cj.LubricatedJoint):
        return with_fields(element, dry=with_names(element.dry, names))
    values = {field.name: getattr(element, field.name) for field in fields(element)}
    changes = {k: names[v] for k, v in values.items() if isinstance(v, str) and v in names}
    changes |= {k: with_names(v, names) for k, v in values.items() if isinstance(v, cj.Encoder)}
    return with_fields(element, **changes)


def exchanged(element: Any) -> Any:
    """The same element with its first and second body, and all that belongs to them, exchanged.

    Angles must be counted from parallel frames, or from an `orientation`, and the two axes of an
    element must have equal components.
    """
    values = {field.name: getattr(element, field.name) for field in fields(element)}
    changes = {
        name: values[re.sub("first|second", _other_side, name)]
        for name in values
        if re.search("first|second", name)
    }
    if isinstance(element, cj.BallInSocket):
        return with_fields(
            element,
            socket_body=element.ball_body,
            ball_body=element.socket_body,
            socket_point=element.ball_point,
            ball_point=element.socket_point,
        )
    if "orientation" in values and values["orientation"] is not None:
        changes["orientation"] = euler(matrix(element.orientation).T)
    if "axis" in values:
        # A rotation of the second body about an axis is one of the first about the opposite axis.
        own = matrix(values.get("orientation", (1.0, 0.0, 0.0, 0.0)))
        changes["axis"] = -own.T @ np.asarray(element.axis)
    if isinstance(element, cj.Backlash):
        changes["middle"] = -element.middle
    if isinstance(element, cj.GearJoint):
        ratio = element.teeth_first / element.teeth_second
        changes["offset"] = (-ratio if element.internal else ratio) * element.offset
    if isinstance(element, cj.GearBacklash):
        # A tooth of one gear is in a gap of the other, so that half a pitch is between the zeros of
        # gears with an odd sum of teeth.
        first, second = element.teeth_first, element.teeth_second
        odd = (first + second) % 2
        changes["phase"] = element.phase * first / second + odd * math.pi / second
    return with_fields(element, **changes)


def _other_side(match: re.Match[str]) -> str:
    return {"first": "second", "second": "first"}[match.group()]


def backwards(element: Any) -> Any:
    """The element in time that runs backwards: functions of time are reversed, and dampers, which
    then drive the motion, get coefficients of the opposite sign."""
    changes: dict[str, Any] = {}
    for field in fields(element):
        value = getattr(element, field.name)
        if field.name in ODD_IN_TIME:
            changes[field.name] = -np.asarray(value)
        elif isinstance(value, cj.extend.AbstractFunctionOfTime):
            changes[field.name] = reversed_function(value)
    return with_fields(element, **changes)


ODD_IN_TIME = ("damping", "rotational_damping", "derivative", "speed")
"""Fields of forces and drives that are multiplied by a velocity, or are one."""


def reversed_function(function: Any) -> Any:
    """The function of time f(-t)."""
    if isinstance(function, cj.Polynomial):
        odd = np.arange(len(function.coefficients)) % 2
        return cj.Polynomial(np.where(odd, -1.0, 1.0) * function.coefficients)
    times, values = -np.asarray(function.times)[::-1], np.asarray(function.values)[::-1]
    if isinstance(function, cj.PiecewiseConstant):
        # A value holds from its time on, and the first one before all times.
        times = np.concatenate([times[:1] - 1.0, times[:-1]])
    changes = {"times": times, "values": values}
    if hasattr(function, "rates"):
        changes["rates"] = -np.asarray(function.rates)[::-1]
    return with_fields(function, **changes)
