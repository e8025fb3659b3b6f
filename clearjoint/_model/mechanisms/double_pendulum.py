"""The double pendulum of P. Flores et al. 2006, whose first joint has clearance."""

from ..._math.vectors import Scalar
from ..bodies import Body, State, body_state
from ..clearance_joints.clearance import AbstractAxialPolicy, ClearanceJoint
from ..contact.friction import FrictionLaw
from ..contact.laws import AbstractContactLaw
from ..joints.ideal import RevoluteJoint
from ..scene import Scene
from .common import ORIGIN, X_AXIS, Z_AXIS, steel_law


def double_pendulum(
    clearance: Scalar | None = 0.5e-3,
    restitution: Scalar = 0.9,
    *,
    bearing_radius: Scalar = 10e-3,
    journal_length: Scalar = 20e-3,
    law: AbstractContactLaw | None = None,
    friction: FrictionLaw | None = None,
    axial: AbstractAxialPolicy | None = None,
) -> tuple[Scene, State]:
    """Return the double pendulum of Flores et al. 2006 and its state at rest.

    A joint with clearance and the axis Z connects arm 2 to the ground, and an ideal revolute joint
    about X connects arm 3 to arm 2. The paper doesn't name the second axis; only X reproduces its
    statements. Gravity is 9.81 m/s^2 along +Y. Both arms are 1 m long and start at rest with a
    centred journal: arm 2 from the origin along +X, arm 3 from the end of arm 2 along +Z.

    Source: P. Flores, J. Ambrosio, J. C. P. Claro, H. M. Lankarani, Spatial revolute joints with
    clearances for dynamic analysis of multi-body systems, 2006, section 6, Tables 1 and 2.

    **Arguments:**

    - `clearance`: radial, m; ``None`` for an ideal ground joint, without use of other arguments.
    - `law`: normal law of the contacts; by default that of Lankarani and Nikravesh for `STEEL` with
      the requested `restitution`.
    - `bearing_radius`, `journal_length`: m.
    - `friction`: as in `ClearanceJoint`; none by default.
    - `axial`: whether the journal can slide along its axis; by default `FreeAxially()`.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> list(scene.joints)
    ['shoulder', 'elbow']
    """
    # Masses, kg, and moments, kg m^2, of Table 1. Each arm lies along its axis of least moment.
    bodies = {
        "arm 2": Body(7.02, (0.0010, 0.5855, 0.5855)),
        "arm 3": Body(7.02, (0.5855, 0.5855, 0.0010)),
    }
    elbow = RevoluteJoint("arm 2", "arm 3", (0.5, 0.0, 0.0), (0.0, 0.0, -0.5), X_AXIS, X_AXIS)
    if clearance is None:
        shoulder = RevoluteJoint("ground", "arm 2", ORIGIN, (-0.5, 0.0, 0.0), Z_AXIS, Z_AXIS)
    else:
        shoulder = ClearanceJoint(
            "ground",
            "arm 2",
            journal_point=(-0.5, 0.0, 0.0),
            bearing_radius=bearing_radius,
            clearance=clearance,
            journal_length=journal_length,
            law=steel_law(restitution) if law is None else law,
            friction=friction,
            axial=axial,
        )
    scene = Scene(bodies, {"shoulder": shoulder, "elbow": elbow}, gravity=(0.0, 9.81, 0.0))
    state = State({"arm 2": body_state((0.5, 0.0, 0.0)), "arm 3": body_state((1.0, 0.0, 0.5))})
    return scene, state
