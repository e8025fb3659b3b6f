"""Sums of forces and moments along a tilted journal, against integrals by SciPy."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.optimize import brentq

import clearjoint as cj
from clearjoint import GROUND
from clearjoint._dynamics.contact_forces import contact_forces, contact_wrenches
from clearjoint.extend import unpack
from clearjoint.testing import moving
from tests.model.test_line_contact import (
    ACROSS,
    AXIS,
    CLEARANCE,
    LENGTH,
    ORDERS,
    RADIUS,
    STIFFNESS,
    UPWARD,
    pin,
    pose,
)
from tests.support.motions import AT_REST

FRICTION = {"coefficient": 0.2, "regularisation_speed": 0.3}


def offsets(given, positions):
    """Vectors from the bearing's axis to points of the journal's axis at -1 to 1, (n, 3) m."""
    points = given.centre + np.outer(positions, 0.5 * LENGTH * given.turn.apply(AXIS))
    return points - np.outer(points @ AXIS, AXIS)


def loads(joint, poses):
    """Forces, N, and moments about the journal's centre, N m, on the shaft, (n, 6), global."""
    euler = [given.turn.as_quat(scalar_first=True) for given in poses]
    spins = [given.turn.inv().apply(given.spin) for given in poses]
    centres, velocities = [p.centre for p in poses], [p.velocity for p in poses]
    columns = (np.transpose(rows) for rows in (centres, euler, velocities, spins))
    motions = {GROUND: AT_REST, "shaft": moving(*columns)}
    scene = unpack(cj.Scene({"shaft": cj.Body(1.0, (1.0, 1.0, 1.0))}, {"pin": joint}))
    total = np.zeros((len(poses), 6))
    for one in contact_forces(scene, motions, {})["pin"].values():
        forces = one.normal_force, one.friction
        for _, wrench in contact_wrenches(scene.joints["pin"], one.contact, *forces, motions):
            moment = motions["shaft"].direction(wrench.moment)
            parts = np.broadcast_arrays(*wrench.force, *moment, np.zeros(len(poses)))
            total += np.transpose(parts[:6])
    return total


def integral(given, exponent, friction):
    """The same by adaptive quadrature along the axis, from the mean of the law's force."""
    half = 0.5 * LENGTH * given.turn.apply(AXIS)

    def depth(s):
        return np.linalg.norm(offsets(given, [s])) - CLEARANCE

    def density(s):
        deep = depth(s)
        if deep <= 0.0:
            return np.zeros(6)
        across, at = offsets(given, [s])[0], s * half
        normal, push = across / np.linalg.norm(across), STIFFNESS * deep**exponent
        force = -push * normal
        if friction:
            # Midway between the surfaces.
            at = at - across + normal * (RADIUS + 0.5 * deep)
            sliding = given.velocity + np.cross(given.spin, at)
            slip = sliding - normal * (normal @ sliding)
            speed = np.linalg.norm(slip)
            ratio = FRICTION["coefficient"] * np.tanh(speed / FRICTION["regularisation_speed"])
            force = force - ratio * push * slip / speed
        return 0.5 * np.concatenate([force, np.cross(at, force)])

    grid = np.linspace(-1.0, 1.0, 101)
    pairs = [(a, b) for a, b in pairwise(grid) if (depth(a) > 0.0) != (depth(b) > 0.0)]
    borders = [brentq(depth, a, b, xtol=1e-15) for a, b in pairs]
    return quad_vec(density, -1.0, 1.0, epsrel=1e-10, points=borders)[0]


def errors(poses, points, exponent, friction=False):
    """Largest errors of force and moment, over the force of the deepest end along the whole length,
    and over this force at half the length."""
    rub = cj.frictions.RegularisedCoulomb(**FRICTION) if friction else None
    found = [loads(pin(n, exponent, friction=rub), poses) for n in points]
    exact = np.array([integral(given, exponent, friction) for given in poses])
    ends = np.array([np.linalg.norm(offsets(p, [-1.0, 1.0]), axis=1).max() for p in poses])
    scale = np.outer(STIFFNESS * (ends - CLEARANCE) ** exponent, np.repeat([1.0, 0.5 * LENGTH], 3))
    return [np.abs((one - exact) / scale).max(axis=1) for one in found]


POSES = {
    "one end": pose(0.8, 0.6),
    "opposite sides": pose(0.1, 1.5),
    "line": pose(1.5, 0.2),
    "skew line": pose(1.3, 0.1, 0.4),
}


@pytest.mark.parametrize("friction", [False, True])
@pytest.mark.parametrize("exponent", ORDERS)
def test_force_and_moment_are_integrals_along_the_axis(exponent, friction):
    """Of the normal force and of the friction, in all kinds of contact."""
    (found,) = errors(list(POSES.values()), [16], exponent, friction)
    allowed = [5e-3, 5e-3, 1e-7, 1e-7]
    assert (found < allowed).all(), dict(zip(POSES, found, strict=True))


@pytest.mark.parametrize("exponent", [1.0, pytest.param(1.5, marks=pytest.mark.slow)])
def test_errors_of_partial_contact_decrease_with_the_stated_order(exponent):
    """In the mean of many poses, since the error of one depends on where its contact ends."""
    random = np.random.default_rng(0)
    numbers = [(random.uniform(0.0, 0.9), random.uniform(0.3, 1.5)) for _ in range(40)]
    poses = [pose(shift, lean) for shift, lean in numbers if shift + lean > 1.05]
    counts = [8, 16, 32]
    found = [np.sqrt(np.mean(one**2)) for one in errors(poses, counts, exponent)]
    order = -np.polyfit(np.log(counts), np.log(found), 1)[0]
    assert order == pytest.approx(ORDERS[exponent], abs=0.2), found


@pytest.mark.parametrize(("points", "factor"), [(2, 3.0), (3, 1.0), (5, 1.0)])
def test_linear_law_along_a_line_by_closed_form(points, factor):
    """K times the mean depth, and K theta L^2/12 about the centre: two points give three times the
    moment, as two bases do."""
    (found,) = loads(pin(points, 1.0), [pose(1.5, 0.2)])
    angle = 0.2 * CLEARANCE / (0.5 * LENGTH)
    depth = 0.5 * CLEARANCE
    assert found[:3] @ ACROSS == pytest.approx(-STIFFNESS * depth, rel=1e-9)
    moment = STIFFNESS * angle * LENGTH**2 / 12.0
    assert abs(found[3:] @ UPWARD) == pytest.approx(factor * moment, rel=1e-4)


@pytest.mark.parametrize("points", [2, 3, 4, 9])
def test_parallel_journal_has_the_force_of_the_law_and_of_two_bases_with_half_of_it(points):
    poses = [pose(shift, 0.0)._replace(spin=20.0 * AXIS) for shift in (0.9, 1.1, 1.7)]
    rub = cj.frictions.RegularisedCoulomb(**FRICTION)
    found = loads(pin(points, friction=rub), poses)
    bases = loads(pin(None, stiffness=0.5 * STIFFNESS, friction=rub), poses)
    np.testing.assert_allclose(found, bases, rtol=1e-12, atol=1e-12)
    push = STIFFNESS * (np.array([0.0, 0.1, 0.7]) * CLEARANCE) ** 1.5
    np.testing.assert_allclose(loads(pin(points), poses)[:, :3] @ ACROSS, -push, rtol=1e-12)
