"""Derivatives of expectations of functions whose closed form is known."""

import numpy as np
import pytest

import clearjoint as cj
from tests.support.at_end import AtEnd
from tests.support.oscillator import on_spring


def scene_and_state(gravity=(0.3, -0.2, 0.1)):
    scene = cj.Scene({"ball": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}, gravity=gravity)
    return scene, cj.State({"ball": cj.body_state((0.0, 0.0, 0.0))})


def component(k, **size):
    return cj.Uncertain(lambda scene: scene.gravity[k], **size)


def degree_five(now):
    g = now.scene.gravity
    return g.x**5 + 2.0 * g.x * g.y**2 + g.z**2


OUTPUTS = {"f": AtEnd(degree_five)}


def derivatives(uncertain, draws=400, **options):
    options |= {"draws": draws, "progress": False}
    return cj.statistics_derivatives(*scene_and_state(), 1e-3, uncertain, OUTPUTS, **options)


def exact(x, y, z, moments):
    """Derivatives of E[(x+a)^5 + 2 (x+a) (y+b)^2 + (z+c)^2], from E a^2, E a^4, E b^2."""
    a2, a4, b2 = moments
    by_x = 5.0 * (x**4 + 6.0 * x**2 * a2 + a4) + 2.0 * (y**2 + b2)
    return np.array([by_x, 4.0 * x * y, 2.0 * z])


def covered(found, truth):
    low, high = found["f_derivative_low"].values, found["f_derivative_high"].values
    rounding = 1e-12  # the interval of a linear function has no width
    return (low <= truth + rounding) & (truth <= high + rounding)


@pytest.mark.parametrize(
    ("size", "moments"),
    [
        ({"deviation": 0.4}, (0.4**2, 3.0 * 0.4**4, 0.4**2)),
        pytest.param(
            {"half_width": 0.5}, (0.25 / 3.0, 0.0625 / 5.0, 0.25 / 3.0), marks=pytest.mark.slow
        ),
    ],
    ids=["normal", "uniform"],
)
def test_tolerances_give_the_derivatives_in_closed_form(size, moments):
    uncertain = {name: component(k, **size) for k, name in enumerate("xyz")}
    truth = exact(0.3, -0.2, 0.1, moments)
    inside = [covered(derivatives(uncertain, seed=seed), truth) for seed in range(8)]
    assert np.mean(inside) >= 0.8
    if "deviation" in size:
        found = derivatives(uncertain, draws=20_000)
        np.testing.assert_allclose(found["f_derivative"].values, truth, atol=0.15)


@pytest.mark.slow
def test_intervals_of_a_mechanism_hold_the_derivatives_of_the_closed_form():
    """A ball on a spring, 80 runs of two parameters on scales `Log` with deviations of 10 %."""
    scene, state = on_spring(mass=2.0)
    paths = {"k": lambda s: s.forces["spring"].stiffness, "m": lambda s: s.bodies["ball"].mass}
    uncertain = {
        name: cj.Uncertain(cj.Parameter(path, cj.Log()), deviation=0.1)
        for name, path in paths.items()
    }
    outputs = {"v": cj.Peak(cj.quantities.Velocity("ball"), "m/s")}
    # The peak speed, 0.1 m sqrt(k/m), is the exponential of a normal number.
    mean = 0.1 * np.sqrt(50.0) * np.exp(0.5 * 2.0 * 0.05**2)
    truth, inside = np.array([0.5, -0.5]) * mean, []
    for seed in range(100):
        options = {"draws": 80, "seed": seed, "progress": False}
        found = cj.statistics_derivatives(scene, state, 0.5, uncertain, outputs, **options)
        low, high = found["v_derivative_low"].values, found["v_derivative_high"].values
        inside.append((low < truth) & (truth < high))
    print(f"\n100 seeds, 80 runs: {100.0 * np.mean(inside):.1f} % of the intervals")
    assert np.mean(inside) > 0.91


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
        ({"between": (2.0, 1.0)}, "`between` must be two rising, finite bounds"),
        ({"between": (2.0, np.inf)}, "`between` must be two rising, finite bounds"),
    ],
)
def test_bad_distributions_are_refused(size, message):
    with pytest.raises(ValueError, match=message):
        component(0, **size)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"draws": 401}, "`draws` must be even"),
        ({"draws": 20}, "`draws` must be 40 or more for 1 parameters"),
        ({"confidence": 1.0}, "`confidence` must be between 0 and 1"),
        ({"disturbance": -1.0}, "`disturbance` must be positive"),
    ],
)
def test_bad_arguments_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        derivatives({"x": component(0, deviation=0.1)}, **options)
    with pytest.raises(ValueError, match="`uncertain` must be not empty"):
        derivatives({})


def test_results_that_would_share_a_name_are_refused():
    """The standard error of a derivative, and that of the mean of the other output."""
    outputs = dict.fromkeys(["f", "f_derivative"], OUTPUTS["f"])
    wanted = {"x": component(0, deviation=0.1)}, outputs
    with pytest.raises(ValueError, match="is .'f_derivative_standard_error'.: rename an output"):
        cj.statistics_derivatives(*scene_and_state(), 1e-3, *wanted, draws=40)


@pytest.mark.slow
def test_a_design_is_a_sweep_that_can_be_stored_and_extended(tmp_path, capsys):
    scene, state = scene_and_state()
    uncertain = {"x": component(0, between=(1.0, 2.0)), "y": component(1, deviation=0.1)}
    path = tmp_path / "design.zarr"

    def swept(count):
        axes = cj.design(scene, state, uncertain, count, seed=2)
        return cj.sweep(scene, state, 1e-3, axes, OUTPUTS, zipped=True, path=path)

    first = swept(8)
    assert ((first["x"] > 1.0) & (first["x"] < 2.0)).all()
    capsys.readouterr()
    second = swept(16)
    assert "8 of 16 lanes are in the store" in capsys.readouterr().err
    np.testing.assert_array_equal(first["f"].values, second["f"].values[:8])
