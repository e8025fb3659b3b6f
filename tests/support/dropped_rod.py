"""A level rod held at one end by a pin with clearance, let go with the journal centred."""

import clearjoint as cj


def dropped_rod() -> tuple[cj.Scene, cj.State]:
    """The scene and its state at rest; the journal falls along Y and strikes the bearing twice
    before 0.03 s."""
    pin = cj.ClearanceJoint(
        "ground",
        "rod",
        journal_point=(-0.5, 0.0, 0.0),
        bearing_radius=10e-3,
        clearance=0.5e-3,
        journal_length=20e-3,
        law=cj.laws.LankaraniNikravesh(0.9, cj.laws.RavnStiffness(207e9, 0.3)),
    )
    rod = cj.Body(7.02, (0.1, 0.5855, 0.5855))
    scene = cj.Scene({"rod": rod}, {"pin": pin}, gravity=(0.0, 9.81, 0.0))
    return scene, cj.State({"rod": cj.body_state((0.5, 0.0, 0.0))})
