"""A scene for each joint, force and drive of the package, in which it acts between moving bodies.

To add one, call `case` with the element, between the bodies "first" and "second" in a state that
satisfies it, and enter the result in one of the dictionaries that `elements` joins. If the element
is another one when its bodies are exchanged, say so in `ONE_SIDED` of the tests; if it has axes
that may be reversed, in `REVERSIBLE` of `symmetry_transformations.py`.
"""

from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

import clearjoint as cj
from tests.support.symmetry_transformations import euler, renamed, transverse

FIRST, SECOND, THIRD = "first", "second", "third"
AXIS, ACROSS = np.array([2.0, 1.0, -2.0]) / 3.0, np.array([1.0, 2.0, 2.0]) / 3.0
"""Two perpendicular directions."""
TURN = Rotation.from_rotvec([0.3, -0.2, 0.4])
"""Orientation of the second body in the cases of elements that have an `orientation`."""
ON_FIRST, ON_SECOND = np.array([0.05, -0.02, 0.08]), np.array([-0.03, 0.04, 0.02])
"""The element's points, m in body axes."""
STIFFNESS = 1e9
"""Stiffness of contacts, N/m^1.5."""
PLAY = 0.2e-3
"""Clearance of contacts, m."""


class Case(NamedTuple):
    """A scene with an element named "element", and a state that satisfies its constraints.

    `rotation`, rad, and `shift`, m, are by how much the second body may be moved relative to the
    first for other states: a little more than the play of a contact.
    """

    scene: cj.Scene
    state: cj.State
    rotation: float
    shift: float


def case(
    element: Any,
    others: Mapping[str, Any] | None = None,
    *,
    apart: Any = None,
    turn: Rotation | None = None,
    third: Any = None,
    rotation: float = 0.5,
    shift: float = 0.05,
) -> Case:
    """The case of an element.

    **Arguments:** `others`: joints that it needs beside it, by name. `apart`: from the first body's
    centre to the second's, m; by default such that `ON_FIRST` and `ON_SECOND` coincide. `turn`: the
    second body's orientation. `third`: from the first body's centre to that of a third body, m.
    """
    turn = Rotation.identity() if turn is None else turn
    apart = ON_FIRST - turn.apply(ON_SECOND) if apart is None else np.asarray(apart)
    places = {FIRST: np.zeros(3), SECOND: apart} | ({} if third is None else {THIRD: third})
    bodies, states = {}, {}
    for k, (name, place) in enumerate(places.items()):
        bodies[name] = cj.Body(0.7 + 0.2 * k, 1e-3 * np.array([2.0 + k, 2.6, 2.8]))
        own = turn if name == SECOND else Rotation.identity()
        states[name] = cj.body_state(place, euler(own.as_matrix()))
    joints, forces = dict(others or {}), {}
    (forces if isinstance(element, cj.extend.AbstractForce) else joints)["element"] = element
    scene = cj.Scene(bodies, joints, forces, (1.0, -9.0, 3.0))
    return Case(scene, cj.State(states), rotation, shift)


PARTS = FIRST, SECOND, ON_FIRST, ON_SECOND
PARALLEL_AXES = AXIS, AXIS
ORIENTATION = euler(TURN.as_matrix())
TILT = Rotation.from_rotvec([0.1, 0.5, -0.2])
"""Orientation of the bushing's axes."""
NOWHERE = np.zeros(3)


def ideal_joints() -> dict[str, Case]:
    """The cases of the ideal joints between two bodies."""
    length, across = 0.2, ACROSS * 0.2
    return {
        "spherical": case(cj.SphericalJoint(*PARTS)),
        "revolute": case(cj.RevoluteJoint(*PARTS, *PARALLEL_AXES)),
        "revolute with an armature": case(cj.RevoluteJoint(*PARTS, *PARALLEL_AXES, 3e-3)),
        "fixed": case(cj.FixedJoint(*PARTS, ORIENTATION), turn=TURN),
        "inline": case(cj.InlineJoint(*PARTS, AXIS)),
        "cylindrical": case(cj.CylindricalJoint(*PARTS, *PARALLEL_AXES)),
        "prismatic": case(cj.PrismaticJoint(*PARTS, AXIS, ORIENTATION), turn=TURN),
        "prismatic with an armature": case(
            cj.PrismaticJoint(*PARTS, AXIS, ORIENTATION, armature=0.4), turn=TURN
        ),
        "universal": case(cj.UniversalJoint(*PARTS, AXIS, ACROSS)),
        "planar": case(cj.PlanarJoint(*PARTS, *PARALLEL_AXES)),
        "point in plane": case(cj.PointInPlaneJoint(*PARTS, AXIS)),
        "line in plane": case(cj.LineInPlaneJoint(*PARTS, AXIS, ACROSS)),
        "distance": case(cj.DistanceJoint(*PARTS, length), apart=ON_FIRST - ON_SECOND + across),
        "screw": case(cj.ScrewJoint(*PARTS, *PARALLEL_AXES, 0.02)),
    }


def geared(
    element: Any, second: Any, third: Any, axis_second: Any, axis_third: Any, rotation: float
) -> Case:
    """The case of two gears, the second and the third body, on the first as their carrier."""
    hinges = {
        f"hinge of the {name}": cj.RevoluteJoint(FIRST, name, place, NOWHERE, axis, axis)
        for name, place, axis in ((SECOND, second, axis_second), (THIRD, third, axis_third))
    }
    return case(element, hinges, apart=second, third=third, rotation=rotation, shift=0.0)


def gears(lossless: bool) -> dict[str, Case]:
    """The cases of meshing gears, ideal and with backlash."""
    on_carrier = ON_FIRST, -ON_FIRST, AXIS, ACROSS, 0.5
    bevel, ring = (
        cj.GearJoint(FIRST, SECOND, THIRD, AXIS, ACROSS, 17, 51, internal, 0.2)
        for internal in (False, True)
    )
    mesh = {"module": 3e-3, "backlash": PLAY, "law": law(lossless)}
    between = SECOND, THIRD, NOWHERE, NOWHERE, AXIS, AXIS
    # The phase at which the gears are near the middle of the play, with the line of centres along
    # `ACROSS` in both.
    start = transverse(AXIS)
    line = np.arctan2(AXIS @ np.cross(start, ACROSS), start @ ACROSS)
    outer, inner = (
        cj.GearBacklash(*between, 20, teeth, **mesh, phase=1e-3 - (1.0 + teeth / 20) * line)
        for teeth in (51, -51)
    )
    # The distances of the axes are a little larger than 3 mm (20 +- 51)/2.
    apart, inside = (ON_FIRST + distance * ACROSS for distance in (0.1066, 0.0466))
    return {
        "gears": geared(bevel, *on_carrier),
        "ring gear": geared(ring, *on_carrier),
        "backlash of gears": geared(outer, ON_FIRST, apart, AXIS, AXIS, 0.015),
        "backlash in a ring gear": geared(inner, ON_FIRST, inside, AXIS, AXIS, 0.015),
    }


def hinged(element: Any, **options: Any) -> Case:
    """The case of an element about an axis that a hinge holds."""
    hinge = cj.RevoluteJoint(*PARTS, AXIS, TURN.inv().apply(AXIS))
    return case(element, {"hinge": hinge}, turn=TURN, **options)


def drives() -> dict[str, Case]:
    """The cases of the drives, with each function of time."""
    about = FIRST, SECOND, AXIS
    turned = {"orientation": ORIENTATION}
    times = np.array([-0.3, -0.1, 0.2, 0.4])
    values = np.array([0.3, -0.2, 0.5, 0.1])
    path = cj.Polynomial([0.0, 0.3, 2.0, -1.0])
    rail = cj.PrismaticJoint(*PARTS, AXIS)
    aimed = cj.Polynomial([0.3, 1.0])
    return {
        "torsional spring": hinged(cj.TorsionalSpring(*about, 5.0, 0.01, 0.2, ORIENTATION)),
        "switched torque": hinged(
            cj.DriveTorque(*about, cj.PiecewiseConstant(times, values), **turned)
        ),
        "motor": hinged(cj.Motor(*about, aimed, 3.0, 0.02, 2.0, ORIENTATION)),
        "servo": hinged(
            cj.Servo(
                *(*about, aimed, 100.0, 3.0, 0.02, 2.0, 0.004, 2.0),
                stall_torque=3.0,
                no_load_speed=20.0,
                encoder=cj.Encoder(*about, ORIENTATION),
                orientation=ORIENTATION,
            )
        ),
        "prescribed rotation": hinged(cj.PrescribedRotation(*about, 3.0, 0.1, ORIENTATION)),
        "prescribed angle": hinged(
            cj.PrescribedAngle(*about, cj.Spline.through(times, values), ORIENTATION)
        ),
        "prescribed translation": case(
            cj.PrescribedTranslation(*PARTS, AXIS, path), {"rail": rail}
        ),
    }


def forces() -> dict[str, Case]:
    """The cases of the forces that need no joint."""
    times = [-0.3, 0.1, 0.4]
    push = cj.PiecewiseLinear(times, [[9.0, 1.0, 2.0], [5.0, 30.0, 1.0], [1.0, 2.0, 3.0]])
    twist = cj.Spline.through(times, [[0.1, 0.2, 0.5], [0.3, -0.2, 0.1], [0.2, 0.2, 0.4]])
    apart = ON_FIRST - ON_SECOND
    return {
        "load": case(cj.AppliedLoad(SECOND, push, twist, ON_SECOND)),
        "spring": case(cj.SpringDamper(*PARTS, 500.0, 2.0, 0.15), apart=apart + 0.2 * ACROSS),
        "bushing": case(
            cj.Bushing(
                *PARTS,
                stiffness=(800.0, 1e3, 1.5e3),
                damping=(3.0, 1.0, 2.0),
                rotational_stiffness=(1.0, 2.0, 3.0),
                rotational_damping=(0.01, 0.03, 0.02),
                orientation_first=euler(TILT.as_matrix()),
                orientation_second=euler((TURN.inv() * TILT).as_matrix()),
            ),
            turn=TURN,
        ),
    }


def law(lossless: bool) -> cj.extend.AbstractContactLaw:
    """A law with damping, or without."""
    return cj.laws.HuntCrossley(1.0 if lossless else 0.7, STIFFNESS)


def contacts(lossless: bool) -> dict[str, Case]:
    """The cases of the other joints with clearance."""
    rub = None if lossless else cj.frictions.RegularisedCoulomb(0.1, 1e-2)
    shared = {"law": law(lossless), "friction": rub}
    points = {"bearing_point": ON_FIRST, "journal_point": ON_SECOND}
    axes = {"bearing_axis": AXIS, "journal_axis": AXIS}
    sizes = {"clearance": PLAY, "journal_length": 20e-3}
    bearing = {**points, **axes, **sizes, "bearing_radius": 10e-3}
    face = {} if rub is None else {"friction": rub, "radius": 12e-3}
    collars = cj.EndPlay(0.1e-3, law(lossless), **face)
    near = {"rotation": 0.02, "shift": 1.5 * PLAY}
    pair = FIRST, SECOND
    plane = {"point": ON_FIRST, "normal": ACROSS, "point_second": ON_SECOND}
    bearings = {
        "bearing": {},
        "bearing along its length": {"line_points": 4},
        "bearing with collars": {"axial": collars},
        "bearing that holds its journal": {"axial": cj.FixedAxially()},
    }
    joints = {
        name: cj.ClearanceJoint(*pair, **bearing, **shared, **options)
        for name, options in bearings.items()
    }
    joints |= {
        "ball": cj.BallInSocket(
            *pair,
            clearance=PLAY,
            socket_radius=10e-3,
            socket_point=ON_FIRST,
            ball_point=ON_SECOND,
            **shared,
        ),
        "pin": cj.PinInSlot(
            *pair,
            play=PLAY,
            pin_radius=5e-3,
            travel=1.5 * PLAY,
            slot_point=ON_FIRST,
            slot_axis=AXIS,
            slot_normal=ACROSS,
            pin_point=ON_SECOND,
            **shared,
        ),
        "slider": cj.SliderInGuide(
            *pair,
            half_length=0.03,
            clearance=PLAY,
            half_height=0.02,
            guide_point=ON_FIRST,
            guide_normal=ACROSS,
            slider_point=ON_SECOND,
            slider_axis=AXIS,
            slider_normal=ACROSS,
            **shared,
        ),
        "point on a plane": cj.Stop(*pair, **plane, **shared),
        "edge on a plane": cj.Stop(
            *pair, **plane, **shared, end_point_second=ON_SECOND + 0.03 * AXIS
        ),
    }
    found = {name: case(joint, **near) for name, joint in joints.items()}
    hinge = {"hinge": cj.RevoluteJoint(*PARTS, *PARALLEL_AXES)}
    play = {"play": 0.03, "radius": 0.02, "middle": 0.005, "law": law(lossless)}
    backlash = cj.Backlash(*pair, axis_first=AXIS, axis_second=AXIS, **play)
    sphere = cj.Stop(*pair, **plane, **shared, radius=0.02)
    balls = {"point_first": ON_FIRST, "point_second": ON_SECOND, **shared}
    on_ball = cj.BallOnBall(*pair, radius_first=0.01, radius_second=0.02, **balls)
    link = cj.MasslessLink(*pair, **points, **axes, **sizes, axial=cj.FixedAxially())
    centres = ON_FIRST - ON_SECOND
    found |= {
        "sphere on a plane": case(sphere, apart=centres + 0.02 * ACROSS, **near),
        "ball on ball": case(on_ball, apart=centres + 0.0297 * ACROSS, **near),
        "backlash": case(backlash, hinge, rotation=0.1),
        "massless link": case(link, apart=centres + PLAY * ACROSS, rotation=1e-3, shift=0.1 * PLAY),
    }
    if lossless:
        return found
    held = cj.SphericalJoint(*PARTS)
    found |= {
        "friction of a hinge": case(
            cj.JointFriction(*pair, rub, 20.0, AXIS, radius=0.01, viscosity=0.3), hinge
        ),
        "friction of a ball": case(
            cj.JointFriction(*pair, cj.frictions.Dahl(0.1), 20.0, radius=0.01), {"ball": held}
        ),
        "friction of a slider": case(
            cj.JointFriction(*pair, rub, 20.0, AXIS, point_second=ON_SECOND, viscosity=0.3),
            {"rail": cj.PrismaticJoint(*PARTS, AXIS)},
        ),
    }
    stuck = {"law": law(False), "friction": cj.frictions.Dahl(0.1)}
    found["bearing with bristles"] = case(cj.ClearanceJoint(*pair, **bearing, **stuck), **near)
    for kind in cj.films.CaponeFilm, cj.films.PinkusSternlichtFilm, cj.films.ButenschoenFilm:
        dry = cj.ClearanceJoint(*pair, **bearing, law=law(False))
        film = cj.LubricatedJoint(dry, kind(0.02), 0.02 * PLAY)
        found[kind.__name__] = case(film, **near)
    return found


@cache
def elements(lossless: bool = False) -> dict[str, Case]:
    """All cases by name; if `lossless`, without the damping and the friction of contacts, and
    without the cases of films and bristles, which always dissipate."""
    return {**ideal_joints(), **gears(lossless), **drives(), **forces(), **contacts(lossless)}


def together(cases: Mapping[str, Case]) -> cj.Scene:
    """All cases in one scene, in which the names of bodies, joints and forces begin with that of
    the case."""
    bodies, joints, forces = {}, {}, {}
    for prefix, one in cases.items():
        names = {name: f"{prefix} {name}" for name in one.scene.bodies}
        scene = renamed(one.scene, names)
        bodies |= scene.bodies
        joints |= {f"{prefix} {name}": joint for name, joint in scene.joints.items()}
        forces |= {f"{prefix} {name}": force for name, force in scene.forces.items()}
    return cj.Scene(bodies, joints, forces, (1.0, -9.0, 3.0))
