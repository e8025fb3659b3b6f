"""Derivatives of the final position after an elastic collision of two equal balls.

The scene is that of https://github.com/keenon/nimblephysics/issues/97, where a simulator with hard
contacts gives 0.75, 0.25, 0.91 and 0.08 for derivatives that are 1, 0, 1 and 0.
"""

import math

import clearjoint as cj
from studies.validation.check import Check

RADIUS, START, SPEED, END = 0.1, 0.52, 1.0, 1.0
"""Radius and initial position, m, speed, m/s, and end time, s."""
STIFFNESS = 1e8
"""Stiffness, N/m, of a linear spring, whose contacts last equally long at any speed."""
CONTACT = math.pi * math.sqrt(0.5 / STIFFNESS)
"""Duration of the contact, s, of a reduced mass of 0.5 kg."""
EXACT = {"x1": 1.0, "x2": 0.0, "v1": END - 0.5 * CONTACT, "v2": 0.5 * CONTACT}
"""Derivatives of x1 + 2 r + v1 T - (v1 - v2) t/2, with the duration t of the contact."""


def collision() -> list[Check]:
    """Check the derivatives of the second ball's final position by the initial state."""
    gap = cj.BallOnBall(
        "first",
        "second",
        radius_first=RADIUS,
        radius_second=RADIUS,
        law=cj.laws.Hertz(STIFFNESS, exponent=1.0),
    )
    ball = cj.Body(1.0, (0.004, 0.004, 0.004))
    scene = cj.Scene({"first": ball, "second": ball}, {"gap": gap})
    start = cj.State(
        {
            "first": cj.body_state((0.0, 0.0, 0.0), velocity=(SPEED, 0.0, 0.0)),
            "second": cj.body_state((START, 0.0, 0.0)),
        }
    )
    parameters = {
        "x1": cj.Parameter.initial(lambda state: state.bodies["first"].position[0]),
        "x2": cj.Parameter.initial(lambda state: state.bodies["second"].position[0]),
        "v1": cj.Parameter.initial(lambda state: state.bodies["first"].velocity[0]),
        "v2": cj.Parameter.initial(lambda state: state.bodies["second"].velocity[0]),
    }
    output = {"x": cj.quantities.Position("second", "x")}
    settings = cj.Settings(rtol=1e-11)
    found = cj.sensitivities(scene, start, END, parameters, output, [END], settings)
    slopes = dict(zip(parameters, found.derivatives["x"][0], strict=True))
    return [
        Check("nimblephysics#97, closed form", f"dx/d{name}", "", EXACT[name], float(slope))
        for name, slope in slopes.items()
    ]
