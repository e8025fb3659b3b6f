"""The same models in another simulator: Exudyn, an optional extra."""

import numpy as np
import pytest

import clearjoint as cj
from tests.support.one_body import bearing, hinge, one_body

exudyn_models = pytest.importorskip(
    "tests.support.exudyn_models", reason="Exudyn is not installed: pip install -e '.[exudyn]'"
)


@pytest.mark.slow
def test_spatial_double_pendulum_with_ideal_joints():
    """A spherical joint and a revolute joint about a skew axis, full inertias, spinning start."""
    m = exudyn_models
    ends = (np.asarray(m.ELBOW) - centre for centre in (m.CENTRE_1, m.CENTRE_2))
    scene = cj.Scene(
        {"one": cj.Body(m.MASS_1, m.INERTIA_1), "two": cj.Body(m.MASS_2, m.INERTIA_2)},
        {
            "ball": cj.SphericalJoint("ground", "one", (0, 0, 0), -np.asarray(m.CENTRE_1)),
            "elbow": hinge("one", "two", *ends, m.ELBOW_AXIS),
        },
        gravity=m.GRAVITY,
    )
    velocity_1, velocity_2, spin_2 = m.initial_velocities()
    state = cj.State(
        {
            "one": cj.body_state(m.CENTRE_1, velocity=velocity_1, spin=m.SPIN_1),
            "two": cj.body_state(m.CENTRE_2, velocity=velocity_2, spin=spin_2),
        }
    )
    times = np.array([0.25, 0.5, 1.0])
    theirs = m.spatial_double_pendulum(times)
    solution = cj.simulate(scene, state, 1.0, cj.Settings(rtol=1e-9), save=cj.Saving(times))
    for k, name in enumerate(("one", "two")):
        ours = solution.states.bodies[name].position
        np.testing.assert_allclose(ours, theirs[:, k], rtol=0, atol=1e-7)


@pytest.mark.parametrize("restitution", [1.0, 0.9, 0.5])
def test_bounce_by_hunt_and_crossley(restitution):
    """One impact of a journal in its bearing; the two bases share the stiffness of one contact."""
    m = exudyn_models
    theirs = m.bounce(restitution)
    law = cj.laws.HuntCrossley(restitution, 0.5 * m.BOUNCE_STIFFNESS)
    sizes = {"bearing_radius": m.BEARING_RADIUS, "clearance": m.BOUNCE_CLEARANCE}
    pin = {"pin": bearing(law, "journal", **sizes)}
    scene, state = one_body("journal", pin, mass=m.BOUNCE_MASS, velocity=(0, theirs.entry_speed, 0))
    save = cj.Saving(impacts=True)
    solution = cj.simulate(scene, state, 0.007, cj.Settings(rtol=1e-9), save)
    impact = solution.impacts.of("pin", "V")
    assert impact.exit_speed[0] == pytest.approx(theirs.exit_speed, rel=1e-6)
    assert 2 * impact.peak_force[0] == pytest.approx(theirs.peak_force, rel=1e-6)
    assert impact.duration[0] == pytest.approx(theirs.contact_time, rel=1e-6)
