"""A rotor in one bearing with clearance, dry or lubricated."""

import numpy as np

from ..._fields.types import TripleLike
from ..._math.vectors import Scalar
from ..bodies import GROUND, Body, State, body_state
from ..clearance_joints.clearance import ClearanceJoint, FixedAxially
from ..clearance_joints.lubricated import LubricatedJoint
from ..contact.friction import FrictionLaw
from ..contact.laws import AbstractContactLaw
from ..drives.drivers import PrescribedRotation
from ..films import AbstractFilm
from ..scene import Scene
from .common import Z_AXIS, steel_law


def rotor_in_bearing(
    clearance: Scalar = 50e-6,
    *,
    film: AbstractFilm | None = None,
    speed: Scalar = 200.0,
    offset: tuple[float, float] = (0.0, -1.0),
    mass: Scalar = 20.0,
    bearing_radius: Scalar = 25e-3,
    journal_length: Scalar = 25e-3,
    restitution: Scalar = 0.5,
    law: AbstractContactLaw | None = None,
    friction: FrictionLaw | None = None,
    gravity: TripleLike | None = (0.0, -9.81, 0.0),
) -> tuple[Scene, State]:
    """Return a rigid rotor in one bearing, driven at constant speed about Z, and its initial state.

    The rotor is a steel disc of 20 kg with a radius of 100 mm. Its moments of inertia are 0.061 kg
    m^2 about a diameter and 0.1 kg m^2 about its axis; `mass` doesn't change them. The bearing is
    in the disc's middle plane, and an ideal constraint holds the rotor axially. With the film
    `CaponeFilm(0.02)`, for example, whose viscosity is 0.02 Pa s, the journal rises to its
    equilibrium position. The equilibrium is stable up to about 1220 rad/s; at higher speeds, the
    journal whirls at half the rotor's speed.

    **Arguments:**

    - `clearance`: radial, m. `bearing_radius`, `journal_length`: m. `mass`: kg.
    - `film`: an `AbstractFilm`; by default none, for a dry bearing.
    - `speed`: of the rotor, rad/s.
    - `offset`: initial position of the journal along X and Y, divided by the clearance; by default
      the journal touches the wall at the lowest point.
    - `law`: normal law of the contact with the wall; by default that of Lankarani and Nikravesh for
      `STEEL` with the requested `restitution`.
    - `friction`: of the contact with the wall, also with a film; none by default.
    - `gravity`: (3,) m/s^2, along -Y by default; ``None`` for none.

    >>> scene, state = cj.mechanisms.rotor_in_bearing()
    >>> list(scene.joints)
    ['bearing', 'motor']
    """
    bearing = ClearanceJoint(
        GROUND,
        "rotor",
        bearing_radius=bearing_radius,
        clearance=clearance,
        journal_length=journal_length,
        law=steel_law(restitution) if law is None else law,
        friction=friction,
        axial=FixedAxially(),
    )
    # With a film, the lubricated joint replaces the dry one, whose contact it includes: contact
    # replaces the film as the penetration grows to 2 % of the clearance.
    if film is not None:
        bearing = LubricatedJoint(bearing, film, transition=0.02 * clearance)
    motor = PrescribedRotation(GROUND, "rotor", Z_AXIS, speed)
    joints = {"bearing": bearing, "motor": motor}
    position, spin = np.array([*offset, 0.0]) * clearance, np.array([0.0, 0.0, 1.0]) * speed
    state = State({"rotor": body_state(position, spin=spin)})
    return Scene({"rotor": Body(mass, (0.061, 0.061, 0.1))}, joints, gravity=gravity), state
