"""Every check, quantity and reduction of the package has native code.

One primitive without a rule makes XLA compile a whole program, or each start be checked in Python.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._fields.cautions import quiet
from clearjoint._fields.checks import conditions_of, recheck
from clearjoint._native.functions import RULES
from clearjoint._native.lowering import Lowering, aval_of
from clearjoint._native.operations import Operations
from clearjoint.extend import unpack
from tests.internals.scene_files.test_round_trips import ELEMENTS, example
from tests.scene_files.test_round_trips import BODIES, STATE
from tests.support.public_names import concrete_classes

INERTIA = np.array([[1.0, 0.1, 0.0], [0.1, 1.1, -0.2], [0.0, -0.2, 1.2]])


def lower(function: Callable, *arguments: Any) -> None:
    """Convert a function to operations of a native program, without compiling them."""
    closed = jax.make_jaxpr(function)(*jax.tree.map(np.asarray, arguments))
    lowering = Lowering(Operations(), RULES)
    given = [lowering.argument(lowering.region(aval_of(v))) for v in closed.jaxpr.invars]
    lowering.inline(closed, given)


@pytest.mark.parametrize("name", [*ELEMENTS, "Body", "BodyState"])
def test_every_check_is_native(name):
    with quiet():
        subjects = {
            "Body": [*BODIES.values(), cj.Body(1.0, INERTIA)],
            "BodyState": [*STATE.bodies.values()],
        }
        for subject in subjects.get(name) or [example(name)]:
            lower(lambda tree: conditions_of(lambda: recheck(tree)), subject)


def slider_crank() -> tuple[cj.Scene, cj.State]:
    """More than 12 constraints, a joint with clearance and bristles, an accelerometer, a servo."""
    friction = cj.frictions.LuGre(0.2, 0.1, stribeck_speed=0.01, stiffness=1e5, damping=1e2)
    scene, state = cj.mechanisms.slider_crank(friction=friction)
    with quiet():
        sensor = cj.accelerometer(scene, state, "rod", axis=(1, 0, 0), frequency=1e4)
    scene = sensor.scene
    limits = {"stall_torque": 2.0, "no_load_speed": 50.0, "torque_constant": 0.5}
    servo = cj.Servo("ground", "crank", ALONG, 0.5, 200.0, 5.0, **limits)
    scene = cj.Scene(scene.bodies, scene.joints, {**scene.forces, "servo": servo}, scene.gravity)
    return scene, sensor.state


def rotor() -> tuple[cj.Scene, cj.State]:
    return cj.mechanisms.rotor_in_bearing(film=cj.films.PinkusSternlichtFilm(0.05))


PIN, CONTACT, POINT, ALONG = "slider pin", "V", (0.1, 0.0, 0.0), (0.0, 0.0, 1.0)
Q = cj.quantities
QUANTITIES = {
    "AccelerometerReading": [Q.AccelerometerReading("rod accelerometer")],
    "Acceleration": [Q.Acceleration("slider")],
    "Angle": [Q.Angle("crank", about=ALONG)],
    "AngularAcceleration": [Q.AngularAcceleration("rod", "z")],
    "AngularVelocity": [Q.AngularVelocity("rod", "z")],
    "BristleDeflection": [Q.BristleDeflection(PIN, CONTACT)],
    "ContactForce": [Q.ContactForce(PIN)],
    "Distance": [
        Q.Distance("crank", POINT, "slider", POINT),
        Q.Distance("rod", POINT, "slider", POINT, along=ALONG),
    ],
    "Eccentricity": [Q.Eccentricity(PIN)],
    "EntrySpeed": [Q.EntrySpeed(PIN, CONTACT)],
    "FilmForce": [Q.FilmForce("bearing")],
    "FrictionForce": [Q.FrictionForce(PIN, CONTACT)],
    "JointAngle": [Q.JointAngle("crank bearing")],
    "JointAngularAcceleration": [Q.JointAngularAcceleration("crank bearing")],
    "JointAngularVelocity": [Q.JointAngularVelocity("crank bearing")],
    "JournalOffset": [Q.JournalOffset(PIN, "x")],
    "MotorCurrent": [Q.MotorCurrent("servo")],
    "MotorTorque": [Q.MotorTorque("servo")],
    "Multiplier": [Q.Multiplier("motor", "angle")],
    "Penetration": [Q.Penetration(PIN, CONTACT)],
    "PenetrationRate": [Q.PenetrationRate(PIN, CONTACT)],
    "PointAcceleration": [Q.PointAcceleration("rod", POINT, "x", axes="body", gravity=True)],
    "PointPosition": [Q.PointPosition("rod", POINT, "x")],
    "PointVelocity": [Q.PointVelocity("rod", POINT, "x")],
    "Position": [Q.Position("rod", "x")],
    "Reaction": [Q.Reaction("crank bearing", "crank"), Q.Reaction(PIN, "rod", "x")],
    "ReactionMoment": [Q.ReactionMoment("motor", "crank", "z", axes="body")],
    "Velocity": [Q.Velocity("rod", "x")],
}


def lower_at_an_instant(
    function: Callable[[Any], Any], scene: cj.Scene, state: cj.State, coordinates: Any
) -> None:
    """Convert a function of an instant at the end of a step."""
    contacts = {name: joint.deepest() for name, joint in scene.contact_joints().items()}
    speeds, bristles = (
        {name: dict.fromkeys(labels, start) for name, labels in contacts.items()}
        for start in (jnp.zeros(()), jnp.zeros(3))
    )
    sources = ("normal damping", "friction", "film", "stabilisation", "supplied")

    def value(scene, state, bristles, t):
        scene, state, bristles = unpack((scene, state, bristles))
        system = cj.extend.System(scene, cj.extend.Formulation(coordinates))
        variables, work = system.encode(state.bodies), dict.fromkeys(sources, t)

        def now(fraction):
            parts = variables, speeds, work, bristles
            return cj.extend.Instant(system, t * fraction, *parts, inside=now)

        return function(now(1.0))

    lower(value, scene, state, bristles, 0.1)


@pytest.mark.parametrize(
    "coordinates",
    [cj.JointCoordinates(), pytest.param(cj.AbsoluteCoordinates(), marks=pytest.mark.slow)],
    ids=["joint", "absolute"],
)
def test_every_quantity_is_native(coordinates):
    """In joint coordinates, reactions are computed in absolute ones, with 16 constraints."""
    assert set(QUANTITIES) == concrete_classes(Q.AbstractQuantity)
    film = QUANTITIES["FilmForce"]
    others = [one for some in QUANTITIES.values() if some is not film for one in some]
    for quantities, (scene, state) in ((film, rotor()), (others, slider_crank())):

        def values(now, quantities=quantities):
            return [quantity(now) for quantity in quantities]

        lower_at_an_instant(values, scene, state, coordinates)


def test_every_reduction_is_native():
    speed = Q.Velocity("arm 2", "x")
    made = {
        "ArchardWear": cj.ArchardWear("shoulder", 1e-4, 1e9),
        "DissipatedEnergy": cj.DissipatedEnergy(),
        "ImpactCount": cj.ImpactCount("shoulder"),
        "MeanPowerLost": cj.MeanPowerLost(),
        "Peak": cj.Peak(speed, "m/s"),
        "Quantiles": cj.Quantiles(speed, "m/s", np.linspace(-1.0, 1.0, 9)),
        "Integral": cj.Integral(speed, "m"),
        "Statistics": cj.Statistics(speed, "m/s"),
    }
    assert set(made) == concrete_classes(cj.extend.AbstractReduction)

    def results(now):
        return [one.results(one.update(one.start(now), now), now) for one in made.values()]

    lower_at_an_instant(results, *cj.mechanisms.double_pendulum(), cj.JointCoordinates())
