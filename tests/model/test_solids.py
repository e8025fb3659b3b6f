"""Bodies from dimensions, against integrals over slices; orientations from axis and angle."""

import math
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj

STEEL = cj.densities.STEEL


def sliced(area, moments, length, density, nodes=40):
    """Mass and moments across and about z of a solid whose slices at z have an area, m^2, and polar
    second moment of area, m^4, by Gauss's rule."""
    places, weights = np.polynomial.legendre.leggauss(nodes)
    z, w = 0.5 * length * places, 0.5 * length * weights * density
    mass, polar = (w * area(z)).sum(), (w * moments(z)).sum()
    across = 0.5 * polar + (w * area(z) * z**2).sum()
    return mass, across, polar


def test_cylinders_are_those_of_their_slices():
    outer, inner, length = 0.2, 0.15, 0.3
    ring = math.pi / 4 * (outer**2 - inner**2)
    polar = math.pi / 32 * (outer**4 - inner**4)
    mass, across, about = sliced(lambda z: ring + 0 * z, lambda z: polar + 0 * z, length, STEEL)
    tube = cj.Body.cylinder(outer, length, density=STEEL, inner_diameter=inner)
    assert float(tube.mass) == pytest.approx(mass, rel=1e-13)
    np.testing.assert_allclose(tube.inertia, [across, across, about], rtol=1e-13)
    along = cj.Body.cylinder(outer, length, mass=mass, inner_diameter=inner, axis="x")
    np.testing.assert_allclose(along.inertia, [about, across, across], rtol=1e-13)
    rod = cj.Body.rod(0.5, density=STEEL, diameter=0.02)
    disc = cj.Body.cylinder(length=0.5, diameter=0.02, density=STEEL, axis="x")
    np.testing.assert_allclose(rod.inertia, disc.inertia, rtol=1e-15)


def test_spheres_are_those_of_their_slices():
    def ball(radius):
        square = lambda z: radius**2 - z**2  # noqa: E731
        return sliced(
            lambda z: math.pi * square(z),
            lambda z: 0.5 * math.pi * square(z) ** 2,
            2 * radius,
            STEEL,
        )

    mass, across, about = np.subtract(ball(0.05), ball(0.04))
    assert across == pytest.approx(about, rel=1e-13)
    hollow = cj.Body.sphere(0.1, density=STEEL, inner_diameter=0.08)
    assert float(hollow.mass) == pytest.approx(mass, rel=1e-12)
    np.testing.assert_allclose(hollow.inertia, about, rtol=1e-12)
    full = cj.Body.sphere(0.1, mass=2.0)
    np.testing.assert_allclose(full.inertia, 0.4 * 2.0 * 0.05**2, rtol=1e-14)
    assert full.gyration_radius() == pytest.approx(math.sqrt(0.6) * 0.05, rel=1e-14)
    by_matrix = cj.Body(full.mass, np.diag(full.inertia))
    assert by_matrix.gyration_radius() == pytest.approx(full.gyration_radius(), rel=1e-14)


def test_boxes_are_put_together_of_smaller_ones():
    """Two halves with the parallel axis theorem."""
    lengths = np.array([0.3, 0.2, 0.1])
    whole = cj.Body.box(lengths, density=2700.0)
    half = cj.Body.box(lengths * [0.5, 1, 1], density=2700.0)
    beside = float(half.mass) * 0.075**2 * np.array([0, 1, 1])
    assert float(whole.mass) == pytest.approx(2.0 * float(half.mass), rel=1e-14)
    np.testing.assert_allclose(whole.inertia, 2.0 * (half.inertia + beside), rtol=1e-13)


def test_a_slender_rod_has_its_length_only():
    rod = cj.Body.rod(0.4, mass=0.3, axis="z")
    np.testing.assert_allclose(rod.inertia[:2], 0.3 * 0.4**2 / 12, rtol=1e-15)
    bar = cj.Body.rod(0.4, density=STEEL, diameter=math.sqrt(0.3 / (STEEL * 0.1 * math.pi)))
    assert float(bar.mass) == pytest.approx(0.3, rel=1e-14)
    assert float(rod.inertia[2]) == pytest.approx(float(bar.inertia[0]), rel=1e-13)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for mass, length in ((1e-6, 1e-3), (0.5, 0.05), (7.02, 1.0), (1e4, 5.0)):
            cj.Body.rod(length, mass=mass)


def test_measures_may_be_design_variables():
    def moment(length):
        return cj.Body.rod(length, density=STEEL, diameter=0.02).inertia[1]

    exact = STEEL * math.pi * 1e-4 * (0.25 * 0.01**2 + 0.25 * 0.4**2)
    assert float(jax.grad(moment)(0.4)) == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("kind", [np.float32, jnp.float32])
def test_plates_in_single_precision_are_bodies(kind):
    """The largest moment of a plate is the sum of the other two, but for rounding."""
    generator = np.random.default_rng(0)
    for first, second in generator.uniform(0.1, 1.0, (20, 2)):
        inertia = kind(np.array([first, second, first + second]))
        np.testing.assert_allclose(cj.Body(1.0, inertia).inertia, inertia, rtol=1e-7)


def test_an_inertia_matrix_may_be_asymmetric_by_rounding():
    """As a rotated one is whose products of inertia vanish."""
    inertia = np.diag([1e-3, 2e-3, 2.5e-3])
    inertia[0, 1], inertia[1, 0] = 3e-18, -1e-18
    np.testing.assert_array_equal(cj.Body(1.0, inertia).inertia, inertia)
    inertia[0, 1] = 1e-11
    with pytest.raises(ValueError, match="`inertia` must be symmetric"):
        cj.Body(1.0, inertia)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: cj.Body.rod(0.4), "`mass`.*None.*densities.STEEL"),
        (lambda: cj.Body.rod(0.4, density=STEEL), "`diameter` must be given with a density"),
        (lambda: cj.Body.box((1, 1, 1), mass=1, density=1), r"`mass`.*\['mass', 'density'\]"),
        (lambda: cj.Body.rod(-1.0, mass=2.0), "`length` must be positive.*in m"),
        (lambda: cj.Body.rod(0.1, mass=2e3), "`mass`.*longer than thick.*diameter"),
        (lambda: cj.Body.rod(0.5, mass=800.0), "`mass`.*longer than thick.*diameter"),
        (lambda: cj.Body.rod(0.1, mass=1.0, axis="X"), r"`axis`.*\('x', 'y', 'z'\)"),
        (
            lambda: cj.Body.cylinder(0.1, 0.1, mass=1.0, inner_diameter=0.1),
            "`inner_diameter` must be less than the diameter, 0.1 m",
        ),
        (lambda: cj.Body.box(0.1, mass=1.0), r"`lengths`.*\(3,\)"),
        (lambda: cj.Body.box((0.1, 0.0, 0.1), mass=1.0), r"`lengths\[1\]` must be positive"),
        (lambda: cj.Body.sphere(0.1, density=0.0), "`density` must be positive"),
        (lambda: cj.rotation((0, 0, 0), 1.0), "`axis`.*non-zero"),
        (lambda: cj.rotation((0, 0, 1), (1.0, 2.0)), "`angle`.*rad"),
    ],
)
def test_invalid_dimensions_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_mistaken_units_are_warned_of():
    with pytest.warns(cj.UnusualValueWarning, match="`density` is 7.85 kg/m"):
        cj.Body.sphere(0.1, density=7.85)
    with pytest.warns(cj.UnusualValueWarning, match="`angle` is 90 rad"):
        cj.rotation((0, 0, 1), 90.0)


def test_densities_are_those_of_solids():
    known = {name: value for name, value in vars(cj.densities).items() if name.isupper()}
    assert {"STEEL", "ALUMINIUM", "BRASS"} <= set(known)
    assert all(1e3 < value < 12e3 for value in known.values())


def test_rotations_are_those_of_scipy_and_exact_about_an_axis():
    for axis, angle in (((1, -2, 0.5), 0.7), ((0, 0, 3), -2.0), ((0, 1, 0), 0.0)):
        vector = angle * np.array(axis) / np.linalg.norm(axis)
        expected = Rotation.from_rotvec(vector).as_quat(scalar_first=True)
        found = cj.rotation(axis, angle)
        assert isinstance(found, np.ndarray)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-15)
    np.testing.assert_array_equal(cj.rotation((0, 0, 5), 1.0)[1:3], 0.0)
    state = cj.body_state((0, 0, 0), cj.rotation((0, 0, 1), 0.3))
    assert float(state.orientation[3]) == math.sin(0.15)
    slope = jax.jacfwd(lambda angle: cj.rotation((0.0, 0.0, 1.0), angle))(0.5)
    np.testing.assert_allclose(slope, [-0.5 * math.sin(0.25), 0, 0, 0.5 * math.cos(0.25)])
