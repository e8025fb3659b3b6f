"""Derivatives of expectations of polynomials, whose closed form is known."""

import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint.statistics.derivatives import estimate
from clearjoint.statistics.uncertain import unit_cube


class Polynomial(cj.extend.AbstractReduction):
    """A function of the gravity of the scene."""

    function: object

    def start(self, now):
        return jnp.zeros(())

    def update(self, tally, now):
        return tally

    def results(self, tally, now):
        return {"": self.function(now.scene.gravity)}

    def units(self):
        return {"": "1"}


def scene_and_state(gravity=(0.3, -0.2, 0.1)):
    scene = cj.Scene({"ball": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}, gravity=gravity)
    return scene, cj.State({"ball": cj.body_state((0.0, 0.0, 0.0))})


def component(k, **size):
    return cj.Uncertain(lambda scene: scene.gravity[k], **size)


def degree_five(g):
    return g.x**5 + 2.0 * g.x * g.y**2 + g.z**2


def derivatives(uncertain, **options):
    scene, state = scene_and_state()
    outputs = {"f": Polynomial(degree_five)}
    return cj.statistics_derivatives(
        scene, state, 1e-3, uncertain, outputs, progress=False, **{"members": 400, **options}
    )


def exact(x, y, z, moments):
    """Derivatives of E[(x+a)^5 + 2 (x+a) (y+b)^2 + (z+c)^2], from E a^2, E a^4, E b^2."""
    a2, a4, b2 = moments
    return np.array(
        [
            5.0 * (x**4 + 6.0 * x**2 * a2 + a4) + 2.0 * (y**2 + b2),
            4.0 * x * y,
            2.0 * z,
        ]
    )


def covered(found, truth):
    low, high = found["f_derivative_low"].values, found["f_derivative_high"].values
    rounding = 1e-12  # the interval of a linear function has no width
    return (low <= truth + rounding) & (truth <= high + rounding)


def test_normal_tolerances_give_the_derivatives_in_closed_form():
    sigma = 0.4
    uncertain = {name: component(k, deviation=sigma) for k, name in enumerate("xyz")}
    truth = exact(0.3, -0.2, 0.1, (sigma**2, 3.0 * sigma**4, sigma**2))
    inside = [covered(derivatives(uncertain, seed=seed), truth) for seed in range(8)]
    assert np.mean(inside) >= 0.8
    found = derivatives(uncertain, members=20_000)
    np.testing.assert_allclose(found["f_derivative"].values, truth, atol=0.15)


def test_uniform_tolerances_give_the_derivatives_in_closed_form():
    h = 0.5
    uncertain = {name: component(k, half_width=h) for k, name in enumerate("xyz")}
    truth = exact(0.3, -0.2, 0.1, (h**2 / 3.0, h**4 / 5.0, h**2 / 3.0))
    inside = [covered(derivatives(uncertain, seed=seed), truth) for seed in range(8)]
    assert np.mean(inside) >= 0.8


def test_intervals_hold_a_noisy_derivative_as_often_as_stated():
    """A discontinuous output with noise that depends on the parameter: 95 % of 400 intervals."""
    rng, normal = np.random.default_rng(0), np.array([True])
    held = 0
    for _ in range(400):
        z = rng.standard_normal((200, 1))
        y = (z[:, 0] > 0.0) + (1.0 + z[:, 0] ** 2) * rng.standard_normal(200)
        derivatives, errors = estimate(z, y, 200, normal)
        held += abs(derivatives[0] - 1.0 / np.sqrt(2.0 * np.pi)) < 1.96 * errors[0]
    assert 0.91 < held / 400 < 0.98


def test_failed_runs_are_left_out():
    z = np.random.default_rng(0).standard_normal((200, 1))
    y = 3.0 * z[:, 0]
    y[::7] = np.nan
    derivatives, _ = estimate(z, y, 200, np.array([True]))
    assert derivatives[0] == pytest.approx(3.0)
    with pytest.raises(ValueError, match="`members` must be so many that 40 runs succeed"):
        estimate(z, np.where(np.arange(200) < 20, y, np.nan), 200, np.array([True]))


def test_seeds_and_threads_give_the_same_bits():
    uncertain = {"x": component(0, deviation=0.1)}
    first = derivatives(uncertain, threads=1, seed=5)["f_derivative"].values
    assert (first == derivatives(uncertain, threads=2, seed=5)["f_derivative"].values).all()
    assert (first != derivatives(uncertain, seed=6)["f_derivative"].values).all()


def test_a_logarithmic_scale_gives_derivatives_by_the_logarithm():
    parameter = cj.Parameter(lambda scene: scene.gravity[0], cj.Log())
    found = derivatives({"x": cj.Uncertain(parameter, deviation=1e-3)})
    x, y = 0.3, -0.2
    assert float(found["f_derivative"][0]) == pytest.approx(x * (5 * x**4 + 2 * y**2), rel=1e-4)
    assert str(found["coordinate"].values[0]) == "log x"


@pytest.mark.parametrize(
    ("size", "message"),
    [
        ({}, "exactly one"),
        ({"deviation": 1.0, "half_width": 1.0}, "exactly one"),
        ({"deviation": -1.0}, "`deviation` must be positive"),
        ({"between": (2.0, 1.0)}, "`between` must be two rising bounds"),
    ],
)
def test_bad_distributions_are_refused(size, message):
    with pytest.raises(ValueError, match=message):
        component(0, **size)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"members": 401}, "`members` must be even"),
        ({"members": 20}, "`members` must be 40 or more for 1 parameters"),
        ({"confidence": 1.0}, "`confidence` must be between 0 and 1"),
        ({"disturbance": -1.0}, "`disturbance` must be positive"),
    ],
)
def test_bad_arguments_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        derivatives({"x": component(0, deviation=0.1)}, **options)
    with pytest.raises(ValueError, match="`uncertain` must be not empty"):
        derivatives({})


@pytest.mark.parametrize("method", ["sobol", "halton", "latin hypercube", "random"])
def test_designs_fill_the_cube_and_larger_ones_append(method):
    points = unit_cube(3, 64, method, 1)
    assert points.shape == (64, 3) and (points > 0.0).all() and (points < 1.0).all()
    np.testing.assert_allclose(points.mean(axis=0), 0.5, atol=0.12)
    np.testing.assert_array_equal(points, unit_cube(3, 64, method, 1))
    if method != "latin hypercube":
        np.testing.assert_array_equal(points, unit_cube(3, 128, method, 1)[:64])
    with pytest.raises(ValueError, match="`method` must be one of"):
        unit_cube(3, 64, "grid", 1)


def test_sobol_points_of_another_number_than_a_power_of_two_give_advice():
    with pytest.warns(UserWarning, match='`count` is 100.*64 or 128.*"halton"') as caught:
        points = unit_cube(3, 100, "sobol", 1)
    assert len(caught) == 1
    np.testing.assert_array_equal(points, unit_cube(3, 128, "sobol", 1)[:100])


def test_a_design_is_a_sweep_that_can_be_stored_and_extended(tmp_path, capsys):
    scene, state = scene_and_state()
    uncertain = {"x": component(0, between=(1.0, 2.0)), "y": component(1, deviation=0.1)}
    path = tmp_path / "design.zarr"

    def swept(count):
        axes = cj.design(scene, state, uncertain, count, seed=2)
        outputs = {"f": Polynomial(degree_five)}
        return cj.sweep(scene, state, 1e-3, axes, outputs, zipped=True, path=path)

    first = swept(8)
    assert ((first["x"] > 1.0) & (first["x"] < 2.0)).all()
    capsys.readouterr()
    second = swept(16)
    assert "8 of 16 lanes are in the store" in capsys.readouterr().err
    np.testing.assert_array_equal(first["f"].values, second["f"].values[:8])
