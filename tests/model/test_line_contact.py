"""Contact along the length of a tilted journal, against integrals along its axis by SciPy."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint import GROUND
from clearjoint.results import MotionMode
from clearjoint.testing import check_law
from tests.support import many_states
from tests.support.observations import observed

RADIUS, CLEARANCE, LENGTH, STIFFNESS = 10e-3, 0.2e-3, 30e-3, 1e8
AXIS = np.array([2.0, 1.0, -2.0]) / 3.0
ACROSS = np.array([1.0, 2.0, 2.0]) / 3.0
UPWARD = np.cross(AXIS, ACROSS)
SIZES = {"bearing_radius": RADIUS, "clearance": CLEARANCE, "journal_length": LENGTH}
ORDERS = {1.0: 2.0, 1.5: 2.5}
"""Order at which the error decreases for a journal that touches along a part, by exponent."""


def pin(points, exponent=1.5, stiffness=STIFFNESS, axis=AXIS, **options):
    law = cj.laws.Hertz(stiffness, exponent=exponent)
    options = {"law": law, "bearing_axis": axis, "journal_axis": axis, **options}
    return cj.ClearanceJoint(GROUND, "shaft", **SIZES, line_points=points, **options)


class Pose(NamedTuple):
    """Centre of the journal, m, and its turn from the bearing's axis; it moves and spins."""

    centre: np.ndarray
    turn: Rotation
    velocity: np.ndarray = np.array([0.2, -0.1, 0.3])
    spin: np.ndarray = np.array([3.0, -4.0, 20.0])


def pose(shift, lean, aside=0.0):
    """A journal at an offset `shift` along `ACROSS`, whose base W has a further offset `lean` along
    it and `aside` along `UPWARD`, all in clearances."""
    tilt = np.cross(AXIS, lean * ACROSS + aside * UPWARD) * CLEARANCE / (0.5 * LENGTH)
    size = np.linalg.norm(tilt)
    turn = Rotation.from_rotvec(np.arcsin(size) * tilt / size if size > 0.0 else np.zeros(3))
    return Pose(shift * CLEARANCE * ACROSS, turn)


FRICTION = {"coefficient": 0.2, "regularisation_speed": 0.3}


def offsets(given, positions):
    """Vectors from the bearing's axis to points of the journal's axis at -1 to 1, (n, 3) m."""
    points = given.centre + np.outer(positions, 0.5 * LENGTH * given.turn.apply(AXIS))
    return points - np.outer(points @ AXIS, AXIS)


def loads(joint, poses):
    """Forces, N, and moments about the journal's centre, N m, on the shaft, (n, 6), global."""
    scene = cj.Scene({"shaft": cj.Body(1.0, (1.0, 1.0, 1.0))}, {"pin": joint})
    centres, turns, velocities, spins = zip(*poses, strict=True)
    turns = Rotation.concatenate(turns)
    euler, spins = turns.as_quat(scalar_first=True), turns.inv().apply(spins)
    state = cj.BodyState(np.array(centres), euler, np.array(velocities), spins)
    return many_states.loads(scene, cj.State({"shaft": state}))["shaft"]


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


NEAR = 1e-6
"""Distance from a border, in clearances."""
BORDERS = {
    (MotionMode.FREE_FLIGHT, MotionMode.ONE_BASE): (0.6, 0.4),
    (MotionMode.ONE_BASE, MotionMode.LINE_CONTACT): (1.2, 0.2),
    (MotionMode.ONE_BASE, MotionMode.OPPOSITE_SIDES): (0.1, 1.1),
}
"""Shift and lean between two modes."""


@pytest.mark.parametrize("modes", BORDERS, ids=lambda modes: f"{modes[0].name} {modes[1].name}")
def test_modes_change_where_an_end_meets_the_wall(modes):
    """The points that touch lie together at the ends that do, as those of a straight line."""
    shift, lean = BORDERS[modes]
    into_line = modes[1] is MotionMode.LINE_CONTACT
    poses = [pose(shift, lean + (-step if into_line else step)) for step in (-NEAR, NEAR)]
    bodies = [cj.body_state(p.centre, p.turn.as_quat(scalar_first=True)) for p in poses]
    states = [cj.State({"shaft": body}) for body in bodies]
    scene = cj.Scene({"shaft": cj.Body(1.0, (1.0, 1.0, 1.0))}, {"pin": pin(9)})
    found = observed(scene, *states)
    assert tuple(found.modes["pin"]) == modes
    contacts = [found.contacts["pin"][label] for label in pin(9).contact_labels()]
    touching = np.array([one.normal_force > 0.0 for one in contacts]).T
    signs = np.array([np.sign(one.normal @ ACROSS) for one in contacts]).T * touching
    for mode, row, sides in zip(modes, touching, signs, strict=True):
        ends, changes = (row[0], row[-1]), np.count_nonzero(np.diff(row))
        expected = {
            MotionMode.FREE_FLIGHT: (0, 0, {0.0}),
            MotionMode.ONE_BASE: (1, 1, {0.0, 1.0}),
            MotionMode.LINE_CONTACT: (2, 0, {1.0}),
            MotionMode.OPPOSITE_SIDES: (2, 2, {-1.0, 0.0, 1.0}),
        }[mode]
        assert (sum(ends), changes, set(sides)) == expected
    distances = [np.linalg.norm(one.offset[:, :2], axis=1) for one in contacts]
    depths = np.array([one.penetration for one in contacts])
    np.testing.assert_allclose(distances, depths + CLEARANCE, rtol=1e-12)


@pytest.mark.parametrize("points", [1, 65, 2.0, True, "5"])
def test_other_numbers_of_points_are_refused(points):
    with pytest.raises(ValueError, match=f"`line_points` must be .*, but is {points!r}: give the"):
        pin(points)


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_the_law_of_a_point_conforms():
    """A law that has a part of the load."""
    stiffness = cj.laws.RavnStiffness(207e9, 0.3)
    law = cj.laws.LankaraniNikravesh(0.9, stiffness, smoothing=1e-7)
    check_law(next(iter(pin(4, law=law).laws().values())))


@pytest.mark.parametrize("exponent", ORDERS)
def test_forces_begin_with_the_slope_of_the_law(exponent):
    """A step that ends at an onset is corrected where the slope jumps."""
    laws = pin(3, exponent).laws()
    assert {law.slope_jumps() for law in laws.values()} == {exponent == 1.0}


END, START = 0.06, cj.State({"shaft": cj.body_state((0.0, 0.0, -0.02), spin=(0.0, 0.0, 40.0))})


def overhung(points, law):
    """A shaft that falls in its bearing while it spins, and whose centre is beside the bearing."""
    joint = cj.ClearanceJoint(
        *(GROUND, "shaft"),
        **SIZES,
        journal_point=(0.0, 0.0, 0.02),
        law=law,
        friction=cj.frictions.RegularisedCoulomb(0.1, 1e-2),
        axial=cj.FixedAxially(),
        line_points=points,
    )
    shaft = cj.Body.cylinder(15e-3, 60e-3, density=cj.densities.STEEL)
    return cj.Scene({"shaft": shaft}, {"pin": joint}, gravity=(0.0, -9.81, 0.0))


def test_ledger_closes_in_all_modes():
    law = cj.laws.LankaraniNikravesh(0.7, 2e9)
    scene, settings = overhung(5, law), cj.Settings(rtol=1e-9, ledger=True)
    solution = cj.simulate(scene, START, END, settings, save=cj.Saving(steps=True, impacts=True))
    observed = cj.observe(scene, solution, solution.steps)
    assert set(observed.modes["pin"]) == {*MotionMode}
    assert set(solution.impacts.contact) == set(scene.joints["pin"].contact_labels())
    exchanged = np.ptp(observed.energies["gravity"])
    assert np.abs(observed.ledger_residual()).max() < 1e-8 * exchanged
    assert observed.energies["friction"][-1] > 0.1 * exchanged
    assert observed.energies["normal damping"][-1] > 0.1 * exchanged
