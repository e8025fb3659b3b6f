"""Contact along the length of a tilted journal, against integrals along its axis by SciPy."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint import GROUND
from clearjoint.plot.report_page import joint_rows
from clearjoint.results import MotionMode
from tests.support.dropped_rod import dropped_rod
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


@pytest.mark.slow
def test_motion_in_the_plane_is_that_with_bases():
    """Over seven impacts, with half the stiffness at each of two bases."""
    scene, state = dropped_rod()

    def final(points, stiffness):
        law = cj.laws.LankaraniNikravesh(0.9, stiffness)
        joint = replace(scene.joints["pin"], law=law, line_points=points)
        changed = replace(scene, joints={"pin": joint})
        rod = cj.simulate(changed, state, 0.1, cj.presets.accurate).final.bodies["rod"]
        return np.concatenate([rod.position, rod.velocity, rod.spin])

    np.testing.assert_allclose(final(3, 1.2e11), final(None, 6e10), rtol=1e-10, atol=1e-12)


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
    states = [cj.body_state(p.centre, p.turn.as_quat(scalar_first=True)) for p in poses]
    scene = cj.Scene({"shaft": cj.Body(1.0, (1.0, 1.0, 1.0))}, {"pin": pin(9)})
    found = observed(scene, "shaft", states)
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


def test_reports_name_the_law_of_the_whole_length():
    scene = overhung(3, cj.laws.LankaraniNikravesh(0.7, 2e9))
    dry = scene.joints["pin"]
    film = cj.LubricatedJoint(dry, cj.films.CaponeFilm(0.02), transition=1e-6)
    lubricated = cj.Scene(scene.bodies, {"pin": film})
    for one in (scene, lubricated):
        (row,) = joint_rows(one, 1)
        assert row[4] == "LankaraniNikravesh, c 0.7"


@pytest.mark.slow
def test_derivative_by_the_clearance_is_that_of_differences():
    """By Richardson's extrapolation, over an impact along the whole length, whose points separate
    one after the other, and three impacts of ends."""

    def path(scene):
        return scene.joints["pin"].clearance

    # The slope of this law's force jumps at the onset, and its force depends on the entry speed.
    law = cj.laws.LankaraniNikravesh(0.7, 1e7, exponent=1.0)
    scene, end = overhung(3, law), 0.018
    outputs = {axis: cj.quantities.Position("shaft", axis) for axis in "xy"}
    parameters = {"clearance": cj.Parameter(path)}
    found = cj.sensitivities(scene, START, end, parameters, outputs, [end])
    settings = cj.Settings(rtol=1e-12)

    def position(change):
        changed = cj.set_value(scene, path, CLEARANCE * (1.0 + change))
        return np.asarray(cj.simulate(changed, START, end, settings).final.bodies["shaft"].position)

    def slope(step):
        return (position(step) - position(-step)) / (2.0 * step * CLEARANCE)

    exact = (4.0 * slope(0.5e-4) - slope(1e-4)) / 3.0
    derivatives = [found.derivatives[axis][0, 0] for axis in "xy"]
    np.testing.assert_allclose(derivatives, exact[:2], rtol=1e-6)
