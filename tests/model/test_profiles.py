"""Profiles of bearings and journals: contact geometry, equilibria, derivatives and refusals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint import GROUND
from clearjoint.extend import pack, unpack
from clearjoint.frictions import RegularisedCoulomb
from clearjoint.laws import Hertz
from clearjoint.profiles import Harmonics, PeriodicSpline
from clearjoint.testing import check_contact_joint, moving
from tests.support.motions import AT_REST

RADIUS, CLEARANCE, STIFFNESS = 10e-3, 0.5e-3, 1e9
ANGLES = np.linspace(0.0, 2.0 * np.pi, 50)


def pin(bearing=None, journal=None, **options):
    options = {"journal_length": 20e-3, "law": Hertz(STIFFNESS), **options}
    return cj.ClearanceJoint(
        options.pop("frame", GROUND),
        "arm",
        bearing_radius=RADIUS,
        clearance=options.pop("clearance", CLEARANCE),
        bearing_profile=bearing,
        journal_profile=journal,
        **options,
    )


def contact(joint, motion):
    contacts = unpack(joint).contacts({GROUND: AT_REST, "arm": motion})
    return jax.tree.map(np.asarray, pack(contacts["V"]))


def tumbling(position=(0.3e-3, -0.4e-3, 1e-3), tilt=0.01):
    rotation = Rotation.from_euler("zyx", [0.7, tilt, -2 * tilt]).as_quat(scalar_first=True)
    return moving(position, rotation, (0.1, 0.2, -0.1), (0.3, -0.2, 2.0))


def assert_same(found, expected, *parts):
    np.testing.assert_allclose(found.gap.depth, expected.gap.depth, rtol=0.0, atol=1e-17)
    for part in ("normal", "slip", *parts):
        np.testing.assert_allclose(
            getattr(found, part), getattr(expected, part), rtol=0.0, atol=1e-12
        )


@pytest.mark.parametrize("part", ["bearing", "journal"])
def test_the_first_harmonic_shifts_the_circle(part):
    shift = np.array([60e-6, -80e-6, 0.0])
    harmonic = Harmonics(shift[:1], shift[1:2])
    options = {"friction": RegularisedCoulomb(0.1)}
    motion = tumbling(tilt=0.0)
    shifted = contact(pin(**{f"{part}_point": shift}, **options), motion)
    found = contact(pin(**{part: harmonic}, **options), motion)
    assert_same(found, shifted, "arm_first", "arm_second")
    np.testing.assert_allclose(found.gap.rate, shifted.gap.rate, rtol=0.0, atol=1e-12)


def aligned(x, y):
    """At rest, its axis parallel to the bearing's."""
    return moving((x, y, 0.0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))


def test_of_many_waves_the_deepest_is_found():
    """The search by 48 angles finds the largest of several maxima."""
    wall, t = Harmonics([0.0] * 5 + [50e-6]), np.linspace(0.0, 2.0 * np.pi, 20_001)
    for x, y in np.random.default_rng(5).normal(size=(5, 2)) * 0.4e-3:
        along = x * np.cos(t) + y * np.sin(t) - 50e-6 * np.cos(6 * t)
        found = contact(pin(wall), aligned(x, y)).gap.depth
        assert float(found) == pytest.approx(along.max() - CLEARANCE, abs=1e-10)


def test_a_journal_rests_where_its_load_presses_it():
    """Both bases carry half of the load there, and the wall's normal is along the load."""
    joint = pin(Harmonics([0.0, 30e-6, -10e-6], [0.0, 20e-6, 0.0]))
    load = np.array([3.0, -2.0, 0.5])
    x, y, _ = joint.resting_joint(load).attachments()[0][2]
    found, size = contact(joint, aligned(x, y)), np.hypot(*load[:2])
    assert 2.0 * float(joint.law.elastic_force(found.gap)) == pytest.approx(size, rel=1e-9)
    np.testing.assert_allclose(found.normal[:2], load[:2] / size, rtol=0.0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    "bearing, journal",
    [
        (Harmonics([2e-6, 20e-6, 5e-6], [3e-6, -10e-6, 1e-6]), None),
        (None, Harmonics([2e-6, 20e-6, 5e-6], [3e-6, -10e-6, 1e-6])),
        (
            PeriodicSpline.through(30e-6 * np.cos(2.0 * np.pi * np.arange(12) / 6)),
            Harmonics([2e-6, 1e-6, 8e-6], [1e-6, 3e-6, -2e-6]),
        ),
    ],
)
@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0)])
def test_the_contact_is_consistent(bearing, journal, axis):
    joint = pin(bearing, journal, journal_axis=axis, friction=RegularisedCoulomb(0.2))
    check_contact_joint(joint, {"arm": tumbling()})


def test_a_profile_turned_with_its_bearing_gives_the_same_contact():
    """The wall of a turned bearing has the profile cos(k (angle - turn))."""
    turn, k = 0.9, 3
    amplitude = 15e-6
    wave = amplitude * np.array([0.0, 0.0, 1.0])
    rub = RegularisedCoulomb(0.1)
    still = pin(Harmonics(np.cos(k * turn) * wave, np.sin(k * turn) * wave), friction=rub)
    bearing = pin(Harmonics(wave), friction=rub, frame="frame")
    frame = moving((0, 0, 0), (np.cos(turn / 2), 0, 0, np.sin(turn / 2)), (0, 0, 0), (0, 0, 0))
    expected = contact(still, tumbling())
    found = pack(unpack(bearing).contacts({"frame": frame, "arm": tumbling()})["V"])
    assert_same(found, expected)


@pytest.mark.parametrize("along, sign", [(0, 1.0), (1, -1.0)])
def test_a_two_lobed_bearing_has_its_equilibrium_and_two_stiffnesses(along, sign):
    """With h = a cos(2 angle) and the load on an axis of symmetry: the penetration of the circle,
    n K delta^(n - 1) along the load, and F/(c + h + h'' + delta) across it."""
    amplitude, depth = 40e-6, 10e-6
    joint = unpack(pin(Harmonics([0.0, amplitude])))
    load = STIFFNESS * depth**1.5
    eccentricity = CLEARANCE + sign * amplitude + depth
    centre = np.zeros(2)
    centre[along] = eccentricity

    def force(centre):
        arm = aligned(*centre)
        touch = joint.contacts({GROUND: AT_REST, "arm": arm})["V"]
        size = joint.law.force(touch.gap, None)
        return jnp.stack([touch.normal.x * size, touch.normal.y * size])

    expected = np.zeros(2)
    expected[along] = load
    np.testing.assert_allclose(force(centre), expected, rtol=0.0, atol=1e-9 * load)
    stiffness = np.zeros((2, 2))
    stiffness[along, along] = 1.5 * STIFFNESS * depth**0.5
    across = 1 - along
    stiffness[across, across] = load / (CLEARANCE - 3.0 * sign * amplitude + depth)
    slopes = jax.jacfwd(force)(jnp.asarray(centre))
    np.testing.assert_allclose(slopes, stiffness, rtol=1e-9, atol=1e-3)


def test_the_spline_is_that_of_scipy():
    values = np.random.default_rng(3).normal(size=20) * 1e-6
    profile = PeriodicSpline.through(values)
    knots = np.linspace(0.0, 2.0 * np.pi, 21)
    spline = CubicSpline(knots, [*values, values[0]], bc_type="periodic")
    for k, found in enumerate(profile.at(jnp.asarray(ANGLES - 2.0 * np.pi))):
        np.testing.assert_allclose(found, spline(ANGLES, k), rtol=1e-9, atol=1e-15)


def test_harmonics_are_sums_of_waves():
    cosines, sines = np.random.default_rng(4).normal(size=(2, 5)) * 1e-6
    k = np.arange(1, 6)[:, None]
    wave, other = np.cos(k * ANGLES), np.sin(k * ANGLES)
    found = Harmonics(cosines, sines).at(jnp.asarray(ANGLES))
    np.testing.assert_allclose(found.value, cosines @ wave + sines @ other, rtol=0.0, atol=1e-19)
    np.testing.assert_allclose(
        found.slope, sines @ (k * wave) - cosines @ (k * other), rtol=0.0, atol=1e-18
    )
    np.testing.assert_allclose(
        found.bend, -(cosines @ (k * k * wave)) - sines @ (k * k * other), rtol=0.0, atol=1e-17
    )


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: pin(Harmonics([0.0, 0.6e-3])), "clearance.*larger than the 0.0006 m"),
        (lambda: Harmonics([[1e-6]]), "cosines"),
        (lambda: Harmonics([1e-6, 2e-6], [1e-6]), "sines"),
        (lambda: PeriodicSpline.through([1e-6, 2e-6]), "coefficients"),
        (lambda: Harmonics([np.nan]), "finite"),
    ],
)
def test_unsuitable_profiles_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_wall_that_touches_twice_gives_a_warning():
    with pytest.warns(cj.UnusualValueWarning, match="several points of contact"):
        pin(Harmonics([0.0] * 7 + [10e-6]))
