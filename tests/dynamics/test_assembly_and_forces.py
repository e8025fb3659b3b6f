"""Assembly by projection, springs and loads against closed forms, and the axial policies."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import clearjoint as cj
from clearjoint.extend import Formulation, System, Vector, unpack
from tests.support.observations import penetrations
from tests.support.one_body import ORIGIN, X, Z, bearing, hinge, one_body


def test_assembly_satisfies_positions_and_velocities():
    """A rough guess of the ideal double pendulum is projected; an exact state is unchanged."""
    scene, exact = cj.mechanisms.double_pendulum(clearance=None)
    rough = cj.State(
        {
            "arm 2": cj.body_state((0.52, 0.03, -0.01), velocity=(0.1, 0.2, 0.0), spin=(0, 0, 1)),
            "arm 3": cj.body_state((0.98, 0.0, 0.53), (0.999, 0.0, 0.0, np.sqrt(1 - 0.999**2))),
        }
    )
    state = cj.assemble(scene, rough)
    report = cj.constraint_report(scene, state)
    assert np.abs(report.values).max() < 1e-12
    assert np.abs(report.rates).max() < 1e-12
    assert report.degrees_of_freedom() == 2
    for name, body in cj.assemble(scene, exact).bodies.items():
        np.testing.assert_allclose(body.position, exact.bodies[name].position, rtol=0.0, atol=1e-15)


def test_rows_of_the_jacobian_are_those_of_their_names():
    """Translations and tilts of a hinge about z between the ground and a body at the origin."""
    report = cj.constraint_report(*one_body("rotor", {"hinge": hinge("ground", "rotor")}))
    for name, row in zip(report.names, report.jacobian, strict=True):
        translates, tilts = np.abs(row[:3]).sum() > 0, np.abs(row[3:]).sum() > 0
        assert (translates, tilts) == ("translation" in name, "tilt" in name), name


def test_a_constraint_whose_rows_vanish_is_redundant_there():
    """The length of a rod between coincident points has no gradient: all its rates are zero."""
    rod = cj.DistanceJoint("ground", "rotor", ORIGIN, ORIGIN, length=0.1)
    report = cj.constraint_report(*one_body("rotor", {"rod": rod}))
    assert report.redundant == ("rod: length",)
    assert report.degrees_of_freedom() == 6


def test_spring_and_damper_oscillate_as_in_the_closed_form():
    """m x'' + c x' + k x = 0 from x = 0.3 m: x = exp(-d t)(cos w t + d/w sin w t) 0.3."""
    mass, stiffness, damping, length = 2.0, 50.0, 1.2, 1.0
    spring = cj.SpringDamper("ground", "block", ORIGIN, ORIGIN, stiffness, damping, length)
    place = (length + 0.3, 0, 0)
    scene, state = one_body("block", forces={"spring": spring}, mass=mass, position=place)
    times, settings = np.linspace(0, 3, 40), cj.Settings(rtol=1e-9, ledger=True)
    solution = cj.simulate(scene, state, 3.0, settings, cj.Saving(times))
    d = damping / (2 * mass)
    w = np.sqrt(stiffness / mass - d**2)
    expected = 0.3 * np.exp(-d * times) * (np.cos(w * times) + d / w * np.sin(w * times))
    found = solution.states.bodies["block"].position[:, 0] - length
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8)
    observed = cj.observe(scene, solution)
    assert observed.energies["supplied"][-1] < -1.0
    assert np.abs(observed.ledger_residual()).max() < 1e-8


def test_load_and_torque_accelerate_a_free_body():
    load = cj.AppliedLoad("top", force=(3.0, 0.0, 0.0), torque=(0.0, 0.0, 0.4))
    pushed = one_body("top", forces={"load": load}, mass=1.5, inertia=(0.1, 0.2, 0.25))
    final = cj.simulate(*pushed, 2.0).final.bodies["top"]
    np.testing.assert_allclose(final.position, (0.5 * 3.0 / 1.5 * 4.0, 0, 0), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(final.spin, (0, 0, 0.4 / 0.25 * 2.0), rtol=0.0, atol=1e-9)
    angle = 2.0 * np.arctan2(final.orientation[3], final.orientation[0])
    assert angle == pytest.approx(0.5 * 0.4 / 0.25 * 4.0, abs=1e-6)


@pytest.mark.parametrize(
    ("shift", "clearance", "violated"),
    [
        (0.0, {}, False),
        (0.8e-3, {}, False),
        (0.8e-3, {"rocker foot": 0.9e-3}, False),
        (0.8e-3, {"rocker foot": 0.7e-3, "rocker pin": 0.9e-3}, True),
        (2e-3, {}, True),
        (np.nan, {}, True),
    ],
)
def test_a_violation_of_a_millimetre_or_a_clearance_or_nan_counts(shift, clearance, violated):
    scene, state = cj.mechanisms.four_bar(clearance)
    system = System(unpack(scene), Formulation(cj.AbsoluteCoordinates()))
    variables = system.encode(unpack(state.bodies))
    name = next(iter(variables))
    moved = replace(variables[name], position=variables[name].position + Vector(shift, 0.0, 0.0))
    assert bool(system.constraints_violated({**variables, name: moved}, 0.0)) == violated


SPEED = 50.0
TURN = cj.PrescribedRotation("ground", "crank", (0, 0, 1), speed=SPEED, initial_angle=0.9)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_assembly_moves_a_driven_mechanism_as_with_ideal_joints(seed):
    """The guess is at rest, with journals off their centres; `four_bar` has the closed form."""
    random = np.random.default_rng(seed)
    pins = random.choice(["crank pin", "rocker pin", "rocker foot"], 1 + seed, replace=False)
    clearance = 0.5e-3
    played = {str(pin): clearance for pin in pins}
    scene, expected = cj.mechanisms.four_bar(played, speed=SPEED, motor=TURN)

    def guess(offset):
        bodies = {
            name: cj.body_state(body.position + offset * random.normal(size=3), body.orientation)
            for name, body in expected.bodies.items()
        }
        return cj.State(bodies)

    start = cj.assemble(scene, guess(0.0))
    shifted = cj.assemble(scene, guess(0.1 * clearance))
    struck = cj.assemble(scene, guess(0.0), moving=False)
    centred = cj.assemble(scene, guess(0.1 * clearance), centred=True)
    for name, body in expected.bodies.items():
        np.testing.assert_allclose(start.bodies[name].velocity, body.velocity, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(start.bodies[name].spin, body.spin, rtol=0.0, atol=1e-8)
        # Journals off their centres change directions by about the clearance over a length.
        np.testing.assert_allclose(shifted.bodies[name].velocity, body.velocity, atol=0.02)
    assert cj.constraint_report(scene, shifted).rates == pytest.approx(0.0, abs=1e-9)
    # Without the drive's motion behind the clearances, at least the rocker is far too slow.
    errors = struck.bodies["rocker"].velocity - expected.bodies["rocker"].velocity
    assert np.linalg.norm(errors) > 0.1
    for family in penetrations(scene, centred).values():
        assert max(family.values()) == pytest.approx(-clearance, rel=1e-6)


def test_assembly_warns_of_journals_that_strike_with_much_of_the_energy():
    """A crank turns freely while coupler and rocker rest behind the clearance of its pin."""
    scene, moving = cj.mechanisms.four_bar({"crank pin": 0.5e-3}, speed=SPEED)
    bodies = {
        name: cj.body_state(body.position, body.orientation) for name, body in moving.bodies.items()
    }
    guess = cj.State(bodies | {"crank": moving.bodies["crank"]})
    with pytest.warns(cj.UnusualValueWarning, match="pass moving=True"):
        struck = cj.assemble(scene, guess)
    assert (struck.bodies["rocker"].spin == 0.0).all()
    assert (cj.assemble(scene, guess, moving=False).bodies["rocker"].spin == 0.0).all()
    state = cj.assemble(scene, guess, moving=True)
    # The velocities are those of the mechanism at another speed of the crank.
    ratio = state.bodies["crank"].spin[2] / SPEED
    assert 0.0 < ratio < 1.0
    for name, body in moving.bodies.items():
        np.testing.assert_allclose(
            state.bodies[name].velocity, ratio * body.velocity, rtol=0.0, atol=1e-9
        )
    # A mechanism that moves as one is left as it is, without a warning.
    np.testing.assert_allclose(
        cj.assemble(scene, moving).bodies["rocker"].spin,
        moving.bodies["rocker"].spin,
        rtol=0.0,
        atol=1e-12,
    )


@pytest.mark.slow
def test_assembly_says_if_only_clearances_let_a_driven_mechanism_move():
    """A driven crank is pinned to a plate that a second pin holds to the ground."""
    pin = partial(bearing, cj.laws.Hertz(stiffness=1e9), "plate", clearance=1e-3)
    # The second pin's axis is X, so that the plate cannot follow the crank.
    points = {"bearing_point": (0.2, 0, 0), "journal_point": (0.1, 0, 0)}
    joints = {
        "foot": hinge("ground", "crank"),
        "drive": cj.PrescribedRotation("ground", "crank", Z, speed=1.0),
        "knee": pin("crank", bearing_point=(0.1, 0, 0)),
        "hold": pin(**points, bearing_axis=X, journal_axis=X),
    }
    body = cj.Body(1.0, (0.01, 0.01, 0.01))
    scene = cj.Scene({"crank": body, "plate": body}, joints)
    guess = cj.State({"crank": cj.body_state((0, 0, 0)), "plate": cj.body_state((0.1, 0, 0))})
    with pytest.raises(ValueError, match="pass moving=False"):
        cj.assemble(scene, guess, moving=True)
    with pytest.warns(cj.UnusualValueWarning, match="pass moving=False"):
        state = cj.assemble(scene, guess)
    assert (np.asarray(state.bodies["plate"].velocity) == 0.0).all()
    assert (cj.assemble(scene, guess, moving=False).bodies["plate"].velocity == 0.0).all()
