"""Ball in socket, slider in guide, pin in slot: geometry, conformance, and closed forms."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.special import beta

import clearjoint as cj
from clearjoint.extend import IDENTITY, unpack
from tests.support.differences import by_differences
from tests.support.motions import AT_REST

TIGHT = cj.Settings(rtol=1e-10, atol=1e-13)
LAW = cj.laws.ExactRestitution(0.8, 1e9)
STEEL = cj.laws.RavnStiffness(207e9, 0.3)
G = 9.81


def socket(first: str = "a", second: str = "b", **options: Any) -> cj.BallInSocket:
    given: dict[str, Any] = {"socket_radius": 10e-3, "clearance": 0.2e-3, "law": LAW}
    return cj.BallInSocket(first, second, **(given | options))


def guide(first: str = "a", second: str = "b", **options: Any) -> cj.SliderInGuide:
    given = {"half_length": 0.05, "half_height": 0.025, "clearance": 1e-3, "law": LAW}
    return cj.SliderInGuide(first, second, **(given | options))


def slot(first: str = "a", second: str = "b", **options: Any) -> cj.PinInSlot:
    given = {"play": 1e-3, "pin_radius": 5e-3, "law": LAW}
    return cj.PinInSlot(first, second, **(given | options))


ROUGH = cj.frictions.RegularisedCoulomb(0.1)


@pytest.mark.parametrize(
    ("make", "options", "complaint"),
    [
        (socket, {"clearance": 0.011}, "`clearance` must be smaller than the socket's radius 0.01"),
        (socket, {"law": 1e9}, "`law` must be an AbstractContactLaw"),
        (socket, {"second": "a"}, "another body than"),
        (guide, {"friction": 0.1}, "`friction` must be an AbstractFriction or"),
        (guide, {"clearance": 0.03}, "`clearance` must be smaller than half the slider's"),
        (guide, {"slider_axis": (1, 1, 0)}, "`slider_axis` must be perpendicular"),
        (guide, {"law": cj.laws.Hertz(STEEL)}, "guide's walls are flat"),
        (slot, {"slot_axis": (0, 2, 0)}, "`slot_axis` must be perpendicular"),
        (slot, {"law": cj.laws.Hertz(STEEL)}, "slot's walls are flat"),
        (slot, {"travel": -1.0}, "`travel` must be positive"),
        (slot, {"play": 0.0}, "`play` must be positive"),
    ],
)
def test_invalid_joints_are_refused(make, options, complaint):
    with pytest.raises(ValueError, match=complaint):
        make(**options)


def contact_at(joint: Any, place: Any, label: str) -> cj.extend.Contact:
    """A contact of a body at rest with the ground."""
    body = cj.extend.Motion(cj.extend.Vector(*place), IDENTITY, AT_REST.velocity, AT_REST.spin)
    return unpack(joint).contacts({"ground": AT_REST, "b": body})[label]


def test_the_law_of_the_ball_receives_both_radii():
    """Hertz's stiffness of a sphere of 9.5 mm in a hollow one of 10 mm: 6.610198e10 N/m^1.5 for
    the paper's steel."""
    joint = socket("ground", "b", clearance=0.5e-3, law=cj.laws.Hertz(STEEL))
    gap = contact_at(joint, (0.0, 0.3e-3, 0.4e-3 + 1e-5), "ball").gap
    assert float(gap.depth) == pytest.approx(math.hypot(0.3e-3, 0.41e-3) - 0.5e-3, rel=1e-9)
    force = float(joint.law.elastic_force(gap))
    assert force == pytest.approx(6.610198e10 * float(gap.depth) ** 1.5, rel=1e-7)


def a_ball(mass: float = 2.0, gravity: Any = None, **options: Any) -> tuple[cj.Scene, cj.State]:
    """A body in a socket of the ground, its centre of mass that of the ball."""
    bodies = {"b": cj.Body(mass, (1e-3, 1e-3, 1e-3))}
    joint = socket("ground", "b", **options)
    state = cj.State({"b": cj.body_state((0.0, 0.0, 0.0))})
    return cj.Scene(bodies, {"joint": joint}, gravity=gravity), state


@pytest.mark.slow
def test_a_dropped_ball_meets_its_socket_as_falling_bodies_do():
    """v = sqrt(2 g c) after sqrt(2 c / g), along any direction; it leaves with the restitution but
    for the weight's work during the contact, which a stiff contact keeps small."""
    direction = np.array([2.0, -1.0, 2.0]) / 3.0
    law = cj.laws.ExactRestitution(0.7, 1e16)
    scene, state = a_ball(gravity=G * direction, law=law)
    impacts = cj.simulate(scene, state, 0.02, save=cj.Saving(impacts=True)).impacts
    speed = math.sqrt(2 * G * 0.2e-3)
    assert impacts.onset[0] == pytest.approx(math.sqrt(2 * 0.2e-3 / G), rel=1e-8)
    assert impacts.entry_speed[0] == pytest.approx(speed, rel=1e-8)
    assert impacts.exit_speed[0] == pytest.approx(0.7 * speed, rel=1e-3)
    assert impacts.entry_speed[1] == pytest.approx(impacts.exit_speed[0], rel=1e-8)
    again = impacts.separation[0] + 2 * impacts.exit_speed[0] / G
    assert impacts.onset[1] == pytest.approx(again, rel=1e-8)


def a_pin(**options: Any) -> tuple[cj.Scene, cj.State]:
    """A pin that flies across a slot of the ground, and along it, without weight."""
    bodies = {"b": cj.Body(0.5, (1e-4, 1e-4, 1e-4))}
    state = cj.State({"b": cj.body_state((0.0, 0.0, 0.0), velocity=(0.3, 0.4, 0.0))})
    return cj.Scene(bodies, {"joint": slot("ground", "b", **options)}), state


@pytest.mark.slow
def test_a_pin_rebounds_between_the_walls():
    """Elastically every play/v + T, T = 2 B(2/5, 1/2)/(n + 1) times the deepest penetration over v
    (H. Hertz); with the exact restitution e, at v, e v, e^2 v... At the slot's ends likewise."""
    speed, mass, stiffness, play = 0.4, 0.5, 1e9, 1e-3
    scene, state = a_pin(law=cj.laws.Hertz(stiffness))
    save, settings = cj.Saving(impacts=True), cj.Settings(rtol=1e-9)
    impacts = cj.simulate(scene, state, 0.012, settings, save=save).impacts
    deepest = (1.25 * mass * speed**2 / stiffness) ** 0.4
    lasts = 2.0 * deepest / speed * beta(0.4, 0.5) / 2.5
    np.testing.assert_allclose(np.diff(impacts.onset), play / speed + lasts, rtol=1e-7)
    np.testing.assert_allclose(impacts.largest_penetration, deepest, rtol=1e-6)
    assert list(impacts.contact[:3]) == ["upper wall", "lower wall", "upper wall"]
    scene, state = a_pin(travel=1.2e-3)
    impacts = cj.simulate(scene, state, 0.02, settings, save=save).impacts
    walls = np.isin(impacts.contact, ["lower wall", "upper wall"])
    for chosen, begun in ((walls, 0.4), (~walls, 0.3)):
        assert chosen.sum() >= 3
        expected = begun * 0.8 ** np.arange(chosen.sum())
        np.testing.assert_allclose(impacts.entry_speed[chosen], expected, rtol=1e-6)


def a_slider(**options: Any) -> tuple[cj.Scene, cj.State]:
    """A tilted slider thrown through a guide of the ground, held in the plane by nothing else."""
    bodies = {"b": cj.Body(0.076, (2e-5, 2e-5, 2.7e-5))}
    tilt = cj.rotation((0, 0, 1), 0.01)
    state = cj.State({"b": cj.body_state((0.0, 0.0, 0.0), tilt, (1.0, 0.2, 0.0))})
    return cj.Scene(bodies, {"joint": guide("ground", "b", **options)}), state


@pytest.mark.slow
@pytest.mark.parametrize(
    ("joint", "label", "play", "contacts"),
    [
        (socket("ground", "b"), "ball", 0.2e-3, 1),
        (guide("ground", "b"), "front lower", 1e-3, 2),
        (slot("ground", "b", play=2e-3), "lower wall", 1e-3, 1),
    ],
    ids=["ball", "slider", "pin"],
)
def test_bodies_that_start_outside_are_centred_or_moved_to_rest(joint, label, play, contacts):
    """Midway between its contacts, or at rest under its weight, which the contacts share."""
    scene = cj.Scene({"b": cj.Body(1.0, (1e-3,) * 3)}, {"joint": joint}, gravity=(0, -G, 0))
    state = cj.State({"b": cj.body_state((0.0, 0.004, 0.0))})
    centred = cj.assemble(scene, state)
    assert float(centred.bodies["b"].position[1]) == pytest.approx(0.0, abs=1e-12)
    resting = cj.assemble(scene, state, resting=["joint"])
    assert float(resting.bodies["b"].position[1]) == pytest.approx(-play, abs=1e-5)
    contact = contact_at(joint, resting.bodies["b"].position, label)
    push = float(joint.law.elastic_force(contact.gap))
    assert contacts * push == pytest.approx(G, rel=1e-4)


@pytest.mark.slow
def test_a_pin_deep_in_the_end_of_its_slot_is_not_assembled():
    """It is centred across the slot only."""
    joint = slot("ground", "b", travel=0.1)
    scene = cj.Scene({"b": cj.Body(1.0, (1e-3,) * 3)}, {"joint": joint}, gravity=(0, -G, 0))
    for resting in ([], ["joint"]):
        with pytest.raises(ValueError, match=r"'upper end' of joint 'joint'.* but is 0\.002"):
            state = cj.State({"b": cj.body_state((0.052, 0.0, 0.0))})
            cj.assemble(scene, state, resting=resting)
        state = cj.State({"b": cj.body_state((0.05 + 2e-6, 0.0, 0.0))})
        assert cj.assemble(scene, state, resting=resting).bodies["b"].position[0] > 0.05


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "options", "end", "length"),
    [
        (a_ball, {"gravity": (3.0, -G, 0.0)}, 0.02, "clearance"),
        (a_slider, {}, 0.012, "clearance"),
        (a_pin, {}, 0.006, "play"),
    ],
    ids=["ball", "slider", "pin"],
)
def test_sensitivities_to_the_backlash_agree_with_differences(make, options, end, length):
    scene, state = make(friction=ROUGH, **options)

    def place(scene: cj.Scene) -> Any:
        return getattr(scene.joints["joint"], length)

    outputs = {x: cj.quantities.PointPosition("b", (0.01, 0.02, 0.0), x) for x in "xy"}
    given = {"play": cj.Parameter(place)}
    found = cj.sensitivities(scene, state, end, given, outputs, [end], TIGHT)

    def final(scene: cj.Scene) -> list[float]:
        run = cj.sensitivities(scene, state, end, given, outputs, [end], TIGHT)
        return [run.outputs[x][-1] for x in "xy"]

    numeric = by_differences(final, scene, place, 1e-4 * float(place(scene)))
    exact = np.array([found.derivatives[x][-1, 0] for x in "xy"])
    assert np.abs(numeric).max() > 0.1
    np.testing.assert_allclose(exact, numeric, rtol=1e-5, atol=1e-5 * np.abs(numeric).max())


def test_a_slider_is_drawn_with_its_sizes():
    drawn: dict[str, dict[str, float]] = {}
    pen: Any = SimpleNamespace(
        walls=lambda *_, **sizes: drawn.update(walls=sizes),
        block=lambda *_, **sizes: drawn.update(block=sizes),
    )
    guide(half_length=0.03, half_height=0.01, clearance=1e-4).draw(pen)
    assert drawn["walls"] == pytest.approx({"distance": 0.0202})
    assert drawn["block"] == pytest.approx({"length": 0.06, "height": 0.02})
