"""Ensembles of systems whose statistics and Lyapunov exponents are known in closed form."""

import numpy as np
import pytest

import clearjoint as cj
from tests.support.at_end import AtEnd
from tests.support.oscillator import on_spring

GRAVITY, LENGTH = 9.81, 0.5


def pendulum(angle):
    """A point mass on a rod of `LENGTH` that hangs at the angle zero."""
    hinge = cj.RevoluteJoint("ground", "bob", (0, 0, 0), (0, LENGTH, 0), (0, 0, 1), (0, 0, 1))
    bob = cj.Body(1.0, (1e-9, 1e-9, 1e-9))
    scene = cj.Scene({"bob": bob}, {"hinge": hinge}, gravity=(0.0, -GRAVITY, 0.0))
    position = LENGTH * np.sin(angle), -LENGTH * np.cos(angle), 0.0
    state = cj.body_state(position, (np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)))
    return scene, cj.State({"bob": state})


SPEED = {"v": AtEnd(lambda now: now.bodies["ball"].velocity.x, "m/s")}


@pytest.mark.slow
def test_exponent_of_an_upright_pendulum_is_the_root_of_gravity_over_length():
    scene, state = pendulum(np.pi)
    found = cj.ensemble(scene, state, 2.0, draws=3, exponents=3, disturbance=1e-12)
    exact = np.sqrt(GRAVITY / LENGTH)
    assert float(found["lyapunov_exponent"]) == pytest.approx(exact, rel=1e-3)
    assert float(found["lyapunov_exponent_standard_error"]) < 1e-3 * exact


def test_axes_with_names_of_disturbances_are_refused():
    name = "disturbed velocity x of ball"
    axes = {name: cj.Axis(lambda s: s.bodies["ball"].mass, [1.0, 2.0])}
    with pytest.raises(ValueError, match=f"`axes` must be .* but is '{name}': rename it"):
        cj.ensemble(*on_spring(), 1.0, draws=2, axes=axes)


def test_exponent_of_an_overdamped_pendulum_is_its_slower_rate():
    scene, state = pendulum(0.0)
    damper = cj.TorsionalSpring("ground", "bob", (0, 0, 1), stiffness=0.0, damping=5.0)
    scene = cj.Scene(scene.bodies, scene.joints, {"damper": damper}, scene.gravity)
    found = cj.ensemble(scene, state, 3.0, draws=2, exponents=2)
    half = 0.5 * 5.0 / LENGTH**2
    rate = -half + np.sqrt(half**2 - GRAVITY / LENGTH)
    assert float(found["lyapunov_exponent"]) == pytest.approx(rate, rel=1e-3)


def test_statistics_of_a_linear_system_follow_the_distribution_of_its_starts():
    """v(t) = v0 cos(w t) - 0.1 w sin(w t), where v0 is normal with the deviation of one axis."""
    scene, state = on_spring()
    end, size, draws = 0.05, 1e-4, 400
    options = {"draws": draws, "disturbance": size, "seed": 3}
    found = cj.ensemble(scene, state, end, outputs=SPEED, **options)
    w = 10.0
    # The body has six free velocities, which share the mean square of the disturbance.
    deviation = size / np.sqrt(6.0) * np.cos(w * end)
    mean = -0.1 * w * np.sin(w * end)
    assert float(found["v_deviation"]) == pytest.approx(deviation, rel=4.0 / np.sqrt(2.0 * draws))
    error = float(found["v_standard_error"])
    assert error == pytest.approx(float(found["v_deviation"]) / np.sqrt(draws))
    assert abs(float(found["v_mean"]) - mean) < 4.0 * error
    z = (found["v_quantile"].values - mean) / deviation
    np.testing.assert_allclose(z, [-1.645, 0.0, 1.645], atol=0.4)
    assert (found["v_quantile_standard_error"].values > 0.0).all()


def test_points_share_their_starts_and_failed_runs_are_counted():
    scene, state = on_spring()
    axes = {"stiffness": cj.Axis(lambda s: s.forces["spring"].stiffness, [100.0, 1e12])}
    settings = cj.Settings(max_steps=40)
    with pytest.warns(UserWarning, match="lanes failed"):
        found = cj.ensemble(scene, state, 0.2, axes, SPEED, settings, draws=4, progress=False)
    assert found["failed"].values.tolist() == [0, 4]
    assert np.isfinite(found["v_mean"].values[0]) and np.isnan(found["v_mean"].values[1])
    assert found["v"].dims == ("stiffness", "draw")


@pytest.mark.filterwarnings("ignore:.*lanes failed")
@pytest.mark.parametrize(
    ("by_function", "exponents"),
    [(False, 0), (True, 0), pytest.param(False, 2, marks=pytest.mark.slow)],
)
def test_values_that_a_scene_cannot_have_are_failed_points(by_function, exponents):
    """Each point has the mean of the sweep without disturbances, to first order."""
    scene, state = on_spring()

    def heavier(scene, state, mass):
        return cj.set_value(scene, lambda s: s.bodies["ball"].mass, mass), state

    masses, path = [-1.0, 1.0, 2.0], lambda s: s.bodies["ball"].mass
    axes = {"m": cj.Axis.change(heavier, masses) if by_function else cj.Axis(path, masses)}
    options = {"draws": 4, "progress": False, "exponents": exponents}
    found = cj.ensemble(scene, state, 0.2, axes, SPEED, **options)
    assert found["failed"].values.tolist() == [4, 0, 0]
    swept = cj.sweep(scene, state, 0.2, axes, SPEED, progress=False)
    np.testing.assert_allclose(found["v_mean"], swept["v"], atol=1e-7)
    if exponents:
        assert np.isnan(found["lyapunov_exponent"].values).tolist() == [True, False, False]


@pytest.mark.slow
def test_seeds_threads_and_stores_give_the_same_bits(tmp_path):
    scene, state = cj.mechanisms.slider_crank(0.1e-3)
    axes = {"clearance": cj.Axis(lambda s: s.joints["slider pin"].clearance, [5e-5, 1e-4])}
    outputs = {"force": cj.Peak(cj.quantities.ContactForce("slider pin"), "N")}

    def forces(draws=4, **options):
        options |= {"draws": draws, "progress": False}
        return cj.ensemble(scene, state, 0.004, axes, outputs, **options)["force"].values

    path = tmp_path / "runs.zarr"
    first = forces(threads=1, path=path)
    np.testing.assert_array_equal(first, forces(threads=2))
    np.testing.assert_array_equal(first, forces(draws=6, path=path)[:, :4])
    assert (first != forces(seed=1)).any()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"draws": 1}, "`draws` must be 2 or more, but is 1"),
        ({"disturbance": 0.0}, "`disturbance` must be positive"),
        ({"quantiles": (1.5,)}, "`quantiles` must be levels between 0 and 1"),
        ({"quantiles": ()}, "`quantiles` must be levels .* each once"),
        ({"quantiles": (0.5, 0.5)}, "`quantiles` must be levels .* each once"),
        ({"quantiles": ("median",)}, "`quantiles` must be a number"),
        ({"seed": -1}, "`seed` must be a whole number"),
        ({"axes": [1.0]}, "`axes` must be a dictionary by name"),
        ({"exponents": 1}, "`exponents` must be 0, or a whole number from 2"),
        ({"axes": {"draw": cj.Axis(lambda s: s.gravity[0], [0.0])}}, "not named"),
        ({"axes": {"g": 1.0}}, "must be an Axis"),
    ],
)
def test_bad_arguments_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        cj.ensemble(*on_spring(), 0.1, **options)


def test_sample_times_that_depend_on_the_scene_are_in_the_result():
    def quarters(scene):
        return 0.5 * np.pi * np.arange(5.0) * (scene.bodies["ball"].mass / 100.0) ** 0.5

    axes = {"mass": cj.Axis(lambda scene: scene.bodies["ball"].mass, [0.5, 2.0, -1.0])}
    save = cj.Saving(quarters, states=False)
    options = {"outputs": {"x": cj.quantities.Position("ball", "x")}, "save": save, "draws": 3}
    with pytest.warns(UserWarning, match="mass"):
        found = cj.ensemble(*on_spring(), lambda s: quarters(s)[-1], axes, **options)
    expected = 0.5 * np.pi * np.arange(5.0) * np.sqrt([[0.005], [0.02], [np.nan]])
    np.testing.assert_allclose(found["saved_time"].transpose("mass", ...), expected, rtol=1e-14)
    assert found["saved_time"].dims == found["x_mean"].dims
    mean = found["x_mean"].isel(mass=slice(2)).transpose("mass", ...)
    np.testing.assert_allclose(mean, [[0.1, 0.0, -0.1, 0.0, 0.1]] * 2, atol=1e-6)


PEAK = cj.Peak(cj.quantities.Velocity("ball"), "m/s")


@pytest.mark.parametrize(
    ("outputs", "options"),
    [
        ({"f": PEAK, "f_mean": PEAK}, {}),
        ({"f_mean": PEAK, "f": PEAK}, {}),
        ({"f_quantile": PEAK, "f": cj.quantities.Position("ball", "x")}, {}),
        ({"failed": PEAK}, {}),
        ({"draw": PEAK}, {}),
        ({"lyapunov_exponent": PEAK}, {"exponents": 2}),
        ({"f": PEAK}, {"axes": {"f_mean": cj.Axis(lambda s: s.bodies["ball"].mass, [1.0])}}),
        ({"f": PEAK}, {"axes": {"failed": cj.Axis(lambda s: s.bodies["ball"].mass, [1.0])}}),
    ],
)
def test_results_that_would_share_a_name_are_refused(outputs, options):
    with pytest.raises(ValueError, match="`outputs` must be outputs whose results have names of"):
        cj.ensemble(*on_spring(), 0.1, outputs=outputs, **options)


def test_a_scene_that_cannot_move_is_refused():
    scene, state = on_spring()
    fixed = cj.FixedJoint("ground", "ball", (0.1, 0, 0), (0, 0, 0))
    scene = cj.Scene(scene.bodies, {"fixed": fixed})
    with pytest.raises(ValueError, match="`scene` must be one that can move"):
        cj.ensemble(scene, state, 0.1)
