"""Identification of friction, damping and inertia from starts at which another program stalls.

The problems are small equivalents of two issues of google-deepmind/mujoco: 3284, whose fit stalls
if friction and damping start at their lower bound of 1e-8, and 3286, whose fit of the LuGre
friction of a motor ends after no iteration, with a derivative of zero.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import clearjoint as cj
from clearjoint.extend import Motions, Scalar
from studies.validation.check import Check

Z = (0.0, 0.0, 1.0)
ORIGIN = (0.0, 0.0, 0.0)
NOISE = 1e-5
"""Standard deviation of the measurements, rad or m."""
LINK = {"mass": 2.12, "inertia": 0.03, "friction": 0.2, "damping": 0.1}
LINK_GUESS = {"mass": 0.5, "inertia": 0.01, "friction": 1e-8, "damping": 1e-8}
"""The link's true values, and those of the start."""
GROW = (0.2, 0.5, 1.0, 2.0)
"""Ends of the windows, s, that are fitted before the whole record of the link."""


class Record(NamedTuple):
    """A run of a scene to an end time, s, of which a quantity is measured to find parameters."""

    scene: cj.Scene
    start: cj.State
    quantity: cj.extend.Quantity
    end: float
    parameters: dict[str, cj.Parameter]


class FrictionLoss(cj.extend.AbstractDriveTorque):
    """Dry and viscous friction about an axis: `loss`, N m, and `damping`, N m s/rad."""

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    loss: float
    damping: float
    axis: tuple[float, float, float] = Z
    orientation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)

    def torque_at(self, angle: Scalar, speed: Scalar, t: Scalar) -> Scalar:
        """Return the torque, N m, at a speed, rad/s; dry friction is smooth below 0.01 rad/s."""
        return -self.loss * jnp.tanh(speed / 0.01) - self.damping * speed


def joint_friction() -> list[Check]:
    """Identify mass, moment of inertia, dry friction and damping of a driven link.

    As in the issue, the true mass is 4.24 times that of the start, and friction and damping start
    at 1e-8. The moment of inertia starts at a third.
    """
    units = {"mass": "kg", "inertia": "kg m^2", "friction": "N m", "damping": "N m s/rad"}
    fit = fitted(driven_link(), LINK_GUESS, GROW)
    return _checks("mujoco#3284, true values", fit, LINK, units)


def driven_link() -> Record:
    """Return a record of the link over 4 s, in which it swings and turns over."""

    def drive(t: Scalar) -> Scalar:
        return 3.0 * jnp.sin(4.0 * t) + 2.0 * jnp.sin(9.0 * t)

    scene = cj.Scene(
        {"link": cj.Body(LINK["mass"], (0.03, 0.03, LINK["inertia"]))},
        {"hinge": cj.RevoluteJoint("ground", "link", ORIGIN, (0.0, 0.2, 0.0), Z, Z)},
        {
            "drive": cj.DriveTorque("ground", "link", Z, drive),
            "friction": FrictionLoss(
                "ground", "link", loss=LINK["friction"], damping=LINK["damping"]
            ),
        },
        gravity=(0.0, -9.81, 0.0),
    )
    start = cj.State({"link": cj.body_state((0.0, -0.2, 0.0))})
    parameters = {
        "mass": cj.Parameter(lambda s: s.bodies["link"].mass, cj.Log()),
        "inertia": cj.Parameter(lambda s: s.bodies["link"].inertia[2], cj.Log()),
        "friction": cj.Parameter(lambda s: s.forces["friction"].loss, cj.Log()),
        "damping": cj.Parameter(lambda s: s.forces["friction"].damping, cj.Log()),
    }
    angle = cj.quantities.JointAngle("hinge")
    return Record(scene, start, angle, 4.0, parameters)


class Floor(cj.extend.AbstractContactJoint):
    """The plane z = 0 of the ground under the centre of a block."""

    body: str
    law: cj.extend.AbstractContactLaw
    friction: cj.extend.AbstractBristleFriction

    def pair(self) -> tuple[str, str]:
        """Return the names of the ground and the block."""
        return "ground", self.body

    def laws(self) -> dict[str, cj.extend.AbstractContactLaw]:
        """Return the contact law."""
        return {"floor": self.law}

    def bristle_laws(self) -> dict[str, cj.extend.AbstractBristleFriction]:
        """Return the friction law."""
        return {"floor": self.friction}

    def friction_force(
        self, name: str, contact: cj.extend.Contact, normal_force: Scalar
    ) -> cj.extend.Vector | None:
        """Return no further friction."""
        return None

    def contacts(self, motions: Motions) -> dict[str, cj.extend.Contact]:
        """Return the contact below the block's centre."""
        place, velocity = motions[self.body].position, motions[self.body].velocity
        down, centre = cj.extend.Vector(0.0, 0.0, -1.0), cj.extend.Vector(0.0, 0.0, 0.0)
        gap = cj.extend.Gap(-place.z, -velocity.z)
        slip = cj.extend.Vector(velocity.x, velocity.y, 0.0)
        under = cj.extend.Vector(place.x, place.y, 0.0)
        return {"floor": cj.extend.Contact(gap, down, under, centre, slip)}


BRISTLES = {"breakaway": 0.25, "kinetic": 0.15, "stiffness": 1e4}
BRISTLES_GUESS = {"breakaway": 0.35, "kinetic": 0.09, "stiffness": 3e4}
"""The true values of the LuGre friction, and those of the start."""


def bristle_friction() -> list[Check]:
    """Identify the LuGre friction of a block that a force moves to and fro on a floor.

    All starts are wrong by 40 % or more. The block sticks where it turns back.
    """
    mass, contact = 2.0, 1e7

    def push(t: Scalar) -> tuple[Scalar, float, float]:
        return 7.0 * jnp.sin(20.0 * t), 0.0, 0.0

    friction = cj.frictions.LuGre(**BRISTLES, stribeck_speed=0.02, damping=10.0)
    floor = Floor("block", cj.laws.Hertz(contact, exponent=1.0), friction)
    block = cj.Body(mass, (1e-2, 1e-2, 1e-2))
    push_load = cj.AppliedLoad("block", force=push)
    scene = cj.Scene(
        {"block": block}, {"floor": floor}, {"push": push_load}, gravity=(0.0, 0.0, -9.81)
    )
    start = cj.State({"block": cj.body_state((0.0, 0.0, -mass * 9.81 / contact))})
    place = cj.quantities.Position("block", "x")
    return _bristle_checks("mujoco#3286, true values", "floor", scene, start, place)


def journal_friction() -> list[Check]:
    """Identify the LuGre friction of a journal that a torque turns to and fro in its bearing.

    The rotor lies in the bearing and rolls up the wall while its journal sticks.
    """
    mass, contact, clearance = 2.0, 1e7, 1e-4

    def drive(t: Scalar) -> Scalar:
        return 0.07 * jnp.sin(20.0 * t)

    bearing = cj.ClearanceJoint(
        "ground",
        "rotor",
        bearing_radius=10e-3,
        clearance=clearance,
        journal_length=20e-3,
        law=cj.laws.ElastoGap(contact, damping=2e3),
        friction=cj.frictions.LuGre(**BRISTLES, stribeck_speed=0.02, damping=10.0),
    )
    joints = {"bearing": bearing, "plane": cj.PlanarJoint("ground", "rotor", ORIGIN, ORIGIN, Z, Z)}
    torque = cj.DriveTorque("ground", "rotor", Z, drive)
    rotor = cj.Body(mass, (1e-3, 1e-3, 1e-3))
    scene = cj.Scene({"rotor": rotor}, joints, {"drive": torque}, gravity=(0.0, -9.81, 0.0))
    # Each of the two bases of the journal carries half the weight.
    depth = 0.5 * mass * 9.81 / contact
    start = cj.State({"rotor": cj.body_state((0.0, -clearance - depth, 0.0))})
    angle = cj.quantities.Angle("rotor", Z)
    source = "mujoco#3286 in a bearing, true values"
    return _bristle_checks(source, "bearing", scene, start, angle)


def _bristle_checks(
    source: str, joint: str, scene: cj.Scene, start: cj.State, quantity: cj.extend.Quantity
) -> list[Check]:
    """Check the identified friction of a joint of a scene, of which 0.6 s are measured."""
    parameters = {
        "breakaway": cj.Parameter(lambda s: s.joints[joint].friction.breakaway, cj.Log()),
        "kinetic": cj.Parameter(lambda s: s.joints[joint].friction.kinetic, cj.Log()),
        "stiffness": cj.Parameter(lambda s: s.joints[joint].friction.stiffness, cj.Log()),
    }
    fit = fitted(Record(scene, start, quantity, 0.6, parameters), BRISTLES_GUESS)
    return _checks(source, fit, BRISTLES, {"breakaway": "", "kinetic": "", "stiffness": "1/m"})


def fitted(record: Record, guess: dict[str, float], grow: Sequence[float] = ()) -> cj.results.Fit:
    """Return the fit of a record of 400 samples with noise from the given guess."""
    scene, start, quantity, end, parameters = record
    times = np.linspace(0.0, end, 401)[1:]
    found = cj.sensitivities(scene, start, end, parameters, {"x": quantity}, times)
    series = {"x": cj.Series(quantity, times, found.outputs["x"], noise=NOISE)}
    measured = cj.Measurements(series).with_noise(np.random.default_rng(0))
    return cj.identify(scene, start, measured, parameters, guess=guess, grow=grow, progress=False)


def _checks(source: str, fit: cj.results.Fit, true: dict, units: dict) -> list[Check]:
    return [
        Check(source, name, units[name], value, fit.estimates[name]) for name, value in true.items()
    ]
