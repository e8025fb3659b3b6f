"""The double four-bar of the IFToMM benchmarks."""

import math

from ...fields.types import TripleLike
from ..bodies import GROUND, Body, State, body_state
from ..joints.ideal import RevoluteJoint
from ..scene import Scene


def double_four_bar() -> tuple[Scene, State]:
    """Two four-bar linkages in a row, the IFToMM benchmark A02 with five rods of 1 m and 1 kg.

    Rods 1, 3 and 5 stand on the ground, 2 and 4 join their tips; gravity 9.81 along -Y, and the
    tips start at 1 m/s along +X. A planar mechanism of seven spatial revolute joints, so that 6 of
    35 constraints are redundant; with the rods in one line it passes singular positions.

    >>> scene, state = cj.mechanisms.double_four_bar()
    >>> list(scene.joints)
    ['foot 1', 'foot 2', 'foot 3', 'left 1', 'right 1', 'left 2', 'right 2']
    """
    names = [f"rod {k}" for k in range(1, 6)]
    bodies = {name: Body(1.0, (1e-3, 1.0 / 12, 1.0 / 12)) for name in names}
    joints, states = {}, {}
    turned = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
    near, far, axis = (-0.5, 0.0, 0.0), (0.5, 0.0, 0.0), (0.0, 0.0, 1.0)

    def hinge(name: str, first: str, second: str, here: TripleLike, there: TripleLike) -> None:
        joints[name] = RevoluteJoint(first, second, here, there, axis, axis)

    for k in (0, 1, 2):
        post = names[2 * k]
        states[post] = body_state((k, 0.5, 0.0), turned, (0.5, 0.0, 0.0), (0.0, 0.0, -1.0))
        hinge(f"foot {k + 1}", GROUND, post, (float(k), 0.0, 0.0), near)
    for k in (0, 1):
        beam = names[2 * k + 1]
        states[beam] = body_state((k + 0.5, 1.0, 0.0), velocity=(1.0, 0.0, 0.0))
        hinge(f"left {k + 1}", names[2 * k], beam, far, near)
        hinge(f"right {k + 1}", beam, names[2 * k + 2], far, far)
    return Scene(bodies, joints, gravity=(0.0, -9.81, 0.0)), State(states)
