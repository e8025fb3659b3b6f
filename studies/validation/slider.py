"""A slider-crank whose slider has clearance in its guide, with two reference files of Siconos.

The example is siconos/siconos-tutorials, examples/mechanics/SliderCrank, with the values of
P. Flores, R. Leine and C. Glocker (Multibody System Dynamics 23, 2010): the contacts of the four
corners are rigid (restitution 0.4) and rub with Coulomb's coefficient 0.01.
"""

import numpy as np

import clearjoint as cj

CRANK, ROD = 0.153, 0.306
"""Lengths, m."""
HALF_LENGTH, HALF_HEIGHT, CLEARANCE = 0.05, 0.025, 1e-3
"""Of the slider, m; on each side, m."""
BODIES = {
    "crank": cj.Body(0.038, (7.4e-5,) * 3),
    "rod": cj.Body(0.038, (5.9e-4,) * 3),
    "slider": cj.Body(0.076, (2.7e-6,) * 3),
}
SPEED, RESTITUTION, FRICTION, GRAVITY = 150.0, 0.4, 0.01, 9.81
"""Initial speed of the crank, rad/s; coefficients; m/s^2."""
STEP = 1e-4
"""Length of the steps of the files, s."""
Z, ORIGIN = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)


def slider_crank() -> tuple[cj.Scene, cj.State]:
    """Return the scene and its initial state, with crank and rod along the guide."""
    law = cj.laws.ExactRestitution(RESTITUTION, 1e9)
    joints = {
        "pivot": cj.RevoluteJoint("ground", "crank", ORIGIN, (-0.5 * CRANK, 0.0, 0.0), Z, Z),
        "elbow": cj.RevoluteJoint(
            "crank", "rod", (0.5 * CRANK, 0.0, 0.0), (-0.5 * ROD, 0.0, 0.0), Z, Z
        ),
        "pin": cj.RevoluteJoint("rod", "slider", (0.5 * ROD, 0.0, 0.0), ORIGIN, Z, Z),
        "guide": cj.SliderInGuide(
            "ground",
            "slider",
            half_length=HALF_LENGTH,
            half_height=HALF_HEIGHT,
            clearance=CLEARANCE,
            law=law,
            friction=cj.frictions.RegularisedCoulomb(FRICTION, 1e-3),
        ),
    }
    # The rod turns so that the slider starts at rest.
    back = -SPEED * CRANK / ROD
    bodies = {
        "crank": cj.body_state(
            (0.5 * CRANK, 0.0, 0.0),
            velocity=(0.0, 0.5 * CRANK * SPEED, 0.0),
            spin=(0.0, 0.0, SPEED),
        ),
        "rod": cj.body_state(
            (CRANK + 0.5 * ROD, 0.0, 0.0),
            velocity=(0.0, -0.5 * ROD * back, 0.0),
            spin=(0.0, 0.0, back),
        ),
        "slider": cj.body_state((CRANK + ROD, 0.0, 0.0)),
    }
    return cj.Scene(BODIES, joints, gravity=(0.0, -GRAVITY, 0.0)), cj.State(bodies)


def motion(step: float, times: np.ndarray) -> np.ndarray:
    """Return the angles of crank and rod, (T, 2) rad, of a run with steps in s."""
    scene, start = slider_crank()
    solution = cj.simulate_nonsmooth(
        scene, start, times[-1], cj.Saving(times), step=step, restitution=RESTITUTION
    )
    assert solution.saved is not None
    bodies = solution.saved.states.bodies
    turned = [
        2.0 * np.arctan2(bodies[name].orientation[:, 3], bodies[name].orientation[:, 0])
        for name in ("crank", "rod")
    ]
    return np.stack(turned, axis=1)
