"""States of scenes that are given without one."""

import numpy as np

import clearjoint as cj
from clearjoint._model.arrangement import arranged_state

Z = (0.0, 0.0, 1.0)


def test_bodies_are_placed_one_after_the_other_by_their_joints():
    first = cj.RevoluteJoint("ground", "first", (1.0, 2.0, 0.0), (-0.5, 0.0, 0.0), Z, Z)
    second = cj.RevoluteJoint("first", "second", (0.5, 0.0, 0.0), (-0.3, 0.0, 0.0), Z, Z)
    bodies = {name: cj.Body(1.0, (0.1, 0.1, 0.1)) for name in ("first", "second")}
    scene = cj.Scene(bodies, {"a": first, "b": second})
    placed = arranged_state(scene).bodies
    np.testing.assert_allclose(placed["first"].position, (1.5, 2.0, 0.0), rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(placed["second"].position, (2.3, 2.0, 0.0), rtol=0.0, atol=1e-15)
    # The first joint is turned by a right angle, the second one by -1.3 times as much.
    turned = arranged_state(scene, angle=0.5 * np.pi).bodies
    np.testing.assert_allclose(turned["first"].position, (1.0, 2.5, 0.0), rtol=0.0, atol=1e-12)
    angle = (0.5 - 0.65) * np.pi
    expected = np.array([1.0, 3.0, 0.0]) + 0.3 * np.array([np.cos(angle), np.sin(angle), 0.0])
    np.testing.assert_allclose(turned["second"].position, expected, rtol=0.0, atol=1e-12)


def test_a_state_of_an_unknown_body_places_no_body():
    pin = cj.RevoluteJoint("ground", "arm", (1.0, 2.0, 0.0), (-0.5, 0.0, 0.0), Z, Z)
    scene = cj.Scene({"arm": cj.Body(1.0, (0.1, 0.1, 0.1))}, {"pin": pin})
    given = cj.State({"other": cj.body_state((0.0, 0.0, 0.0))})
    placed = arranged_state(scene, given).bodies
    assert list(placed) == ["arm"]
    np.testing.assert_allclose(placed["arm"].position, (1.5, 2.0, 0.0), rtol=0.0, atol=1e-15)
