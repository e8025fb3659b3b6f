"""Ball in socket, slider in guide, pin in slot: geometry, conformance, and closed forms."""

import math
from types import SimpleNamespace
from typing import Any

import pytest

import clearjoint as cj
from clearjoint.extend import IDENTITY, unpack
from tests.support.motions import AT_REST

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


@pytest.mark.parametrize(
    ("make", "options", "complaint"),
    [
        (socket, {"clearance": 0.011}, "`clearance` must be smaller than the socket's radius 0.01"),
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


@pytest.mark.slow
@pytest.mark.parametrize("make", [socket, guide, slot])
def test_bodies_that_start_outside_are_centred(make):
    """Midway between its contacts; `test_onsets.py` has where they rest."""
    scene = cj.Scene({"b": cj.Body(1.0, (1e-3,) * 3)}, {"joint": make("ground")})
    centred = cj.assemble(scene, cj.State({"b": cj.body_state((0.0, 0.004, 0.0))}))
    assert float(centred.bodies["b"].position[1]) == pytest.approx(0.0, abs=1e-12)


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


def test_a_slider_is_drawn_with_its_sizes():
    drawn: dict[str, dict[str, float]] = {}
    pen: Any = SimpleNamespace(
        walls=lambda *_, **sizes: drawn.update(walls=sizes),
        block=lambda *_, **sizes: drawn.update(block=sizes),
    )
    guide(half_length=0.03, half_height=0.01, clearance=1e-4).draw(pen)
    assert drawn["walls"] == pytest.approx({"distance": 0.0202})
    assert drawn["block"] == pytest.approx({"length": 0.06, "height": 0.02})
