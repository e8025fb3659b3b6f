"""A conformance check for joints with contacts of one's own."""

from collections.abc import Mapping

from ..dynamics.contact_forces import contact_wrenches
from ..math.vectors import ZERO, Scalar, unpack
from ..model.bodies import GROUND, GROUND_MOTION, Motion, Wrench
from ..model.joints.base import AbstractContactJoint
from .moving_bodies import moved

STEP = 1e-6
"""s, of the differences."""


def check_contacts(
    joint: AbstractContactJoint, motions: Mapping[str, Motion], tolerance: float = 1e-6
) -> None:
    """Check the geometry of a joint's contacts at given motions: the rate of each penetration
    against differences, the power of a normal force of 1 N against that rate, and that it does to
    one body the opposite of what it does to the other.

    **Arguments:** `motions` of both bodies, such as the joints beside it allow: those hold what the
    joint takes for granted. `tolerance`: in m/s, N and N m, for numbers of the size of one.
    """
    joint = unpack(joint)
    here = dict(motions) | {GROUND: GROUND_MOTION}
    ahead, behind = (joint.contacts(moved(here, time)) for time in (STEP, -STEP))
    for label, contact in joint.contacts(here).items():

        def require(found: Scalar, expected: Scalar, message: str, label: str = label) -> None:
            if not abs(float(found - expected)) < tolerance * (1.0 + abs(float(expected))):
                raise AssertionError(f"Contact {label!r}: {message}.")

        rate = (ahead[label].gap.depth - behind[label].gap.depth) / (2.0 * STEP)
        require(contact.gap.rate, rate, "the gap's rate is not that of its depth")
        wrenches = dict(contact_wrenches(joint, contact, 1.0, None, here))
        power = sum(here[name].power(wrench) for name, wrench in wrenches.items())
        require(power, -contact.gap.rate, "the power of 1 N is not minus the rate")
        if len(wrenches) == 2:
            for part in _sum_at_origin(wrenches, here):
                require(part, 0.0, "action and reaction differ")


def _sum_at_origin(
    wrenches: Mapping[str, Wrench], motions: Mapping[str, Motion]
) -> tuple[Scalar, ...]:
    """The sum of forces and of moments about the origin, global."""
    force, moment = ZERO, ZERO
    for name, wrench in wrenches.items():
        motion = motions[name]
        force = force + wrench.force
        moment = moment + motion.position.cross(wrench.force) + motion.direction(wrench.moment)
    return (*force, *moment)
