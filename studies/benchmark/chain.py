"""Chain of rods on the ground, connected by joints with clearance or by ideal hinges."""

import clearjoint as cj

LENGTH, MASS, CLEARANCE, RESTITUTION = 0.2, 1.0, 5e-4, 0.9
"""Length, m, and mass, kg, of a rod; radial clearance, m; restitution."""


def chain(rods: int) -> tuple[cj.Scene, cj.State]:
    """Return slender rods in a row along X, at rest, with joints about Z and gravity along -Y."""
    across = MASS * LENGTH**2 / 12
    law = cj.laws.LankaraniNikravesh(restitution=RESTITUTION, stiffness=cj.mechanisms.STEEL)
    bodies, joints, states = {}, {}, {}
    before, end = "ground", (0.0, 0.0, 0.0)
    for k in range(rods):
        name = f"rod {k + 1}"
        bodies[name] = cj.Body(MASS, (1e-3 * across, across, across))
        states[name] = cj.body_state(((k + 0.5) * LENGTH, 0.0, 0.0))
        joints[f"joint {k + 1}"] = cj.ClearanceJoint(
            before,
            name,
            bearing_point=end,
            journal_point=(-0.5 * LENGTH, 0.0, 0.0),
            bearing_radius=10e-3,
            clearance=CLEARANCE,
            journal_length=20e-3,
            law=law,
        )
        before, end = name, (0.5 * LENGTH, 0.0, 0.0)
    return cj.Scene(bodies, joints, gravity=(0.0, -9.81, 0.0)), cj.State(states)


def ideal_chain(rods: int) -> tuple[cj.Scene, cj.State]:
    """Return slender rods in a row along X, at rest, hinged about Z, with gravity along -Y."""
    scene, state = chain(rods)
    names, end, axis = ["ground", *scene.bodies], (0.5 * LENGTH, 0.0, 0.0), (0.0, 0.0, 1.0)
    before = [(0.0, 0.0, 0.0), *[end] * (rods - 1)]
    hinges = {
        f"hinge {k + 1}": cj.RevoluteJoint(
            names[k], names[k + 1], before[k], (-0.5 * LENGTH, 0.0, 0.0), axis, axis
        )
        for k in range(rods)
    }
    return cj.Scene(scene.bodies, hinges, gravity=scene.gravity), state
