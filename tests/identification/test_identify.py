"""Parameters of the double pendulum from probes in its bearing, to 0.03 s: one impact and a half.

All tests share one compiled run: two probes, three parameters, up to 64 times.
"""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares

import clearjoint as cj

END, NOISE = 0.03, 1e-6
TIMES = np.linspace(0.0, END, 61)[1:]
PROBES = {axis: cj.quantities.JournalOffset("shoulder", axis) for axis in ("x", "y")}
SCENE, STATE = cj.mechanisms.double_pendulum()
PARAMETERS = {
    "young": cj.Parameter(lambda s: s.joints["shoulder"].law.stiffness.young_modulus, cj.Log()),
    "restitution": cj.Parameter(lambda s: s.joints["shoulder"].law.restitution, cj.Bounded(0, 1)),
    "clearance": cj.Parameter(lambda s: s.joints["shoulder"].clearance, cj.Log()),
}
TRUTH = {"young": 207e9, "restitution": 0.9, "clearance": 0.5e-3}
CLOSE = {"young": 400e9, "restitution": 0.85, "clearance": 0.51e-3}


@pytest.fixture(scope="session")
def clean():
    """Measurements without noise, from a run with tighter tolerances than those of the fits."""
    saved = cj.simulate(SCENE, STATE, END, cj.Settings(rtol=1e-12), save=cj.Saving(TIMES))
    rows = zip(PROBES.items(), journal(saved.states), strict=True)
    return cj.Measurements({n: cj.Series(probe, TIMES, row, NOISE) for (n, probe), row in rows})


def journal(states):
    """The journal's centre, the end of arm 2 that lies at (-0.5, 0, 0) in its axes: x, y in m."""
    body = states.bodies["arm 2"]
    e0, e1, e2, e3 = np.asarray(body.orientation).T
    end = np.stack([e0**2 + e1**2 - e2**2 - e3**2, 2.0 * (e1 * e2 + e0 * e3)])
    return np.asarray(body.position).T[:2] - 0.5 * end


@pytest.fixture(scope="session")
def draws(clean):
    generator = np.random.default_rng(5)
    return [clean.with_noise(generator) for _ in range(3)]


@pytest.fixture(scope="session")
def fit(draws):
    return fitted(draws[0], guess=CLOSE)


def true_coordinates():
    return np.array([p.coordinate_in(SCENE, STATE) for p in PARAMETERS.values()])


def fitted(measurements, **options):
    options = {"progress": False, "check_runs": 0, **options}
    return cj.identify(SCENE, STATE, measurements, PARAMETERS, **options)


def test_data_without_noise_give_the_parameters_back(clean):
    fit = fitted(clean, guess=CLOSE, tolerance=1e-6)
    assert fit.ending is cj.results.Ending.CONVERGED
    for name, value in TRUTH.items():
        assert fit.estimates[name] == pytest.approx(value, rel=1e-5 if name == "young" else 1e-6)
    assert fit.chi_squared < 1e-4


def test_same_minimum_as_scipy_on_simulated_residuals(fit, draws):
    """SciPy's least squares by finite differences of `simulate`."""
    base = np.array([draws[0][name].values for name in PROBES])

    def of(coordinates):
        scene = SCENE
        for parameter, coordinate in zip(PARAMETERS.values(), coordinates, strict=True):
            value = float(parameter.scale.value(coordinate))
            scene = cj.set_value(scene, parameter.variation.path, value)
        saved = cj.simulate(scene, STATE, END, cj.Settings(rtol=1e-12), save=cj.Saving(TIMES))
        return ((journal(saved.states) - base) / NOISE).ravel()

    found = least_squares(of, fit.coordinates + 0.01, diff_step=1e-6, x_scale="jac")
    assert 2.0 * found.cost == pytest.approx(fit.chi_squared, abs=1e-4)
    deviations = np.sqrt(np.diag(fit.covariance))
    assert (np.abs(found.x - fit.coordinates) / deviations).max() < 0.02


def test_a_fit_whose_runs_fail_says_so(draws):
    settings = replace(cj.presets.derivatives, max_steps=300)
    failing = fitted(draws[0], settings=settings, max_iterations=3)
    assert failing.ending is cj.results.Ending.FAILED
    assert "does not reach the last sample" in failing.warnings[0]
    squares = sum(np.sum(row**2) for row in failing.residuals.values())
    assert squares == pytest.approx(failing.chi_squared, rel=1e-9) and squares >= 1e6**2


def test_draws_of_noise_are_fitted_as_by_themselves(fit, draws):
    options = {"guess": CLOSE, "progress": False, "check_runs": 0}
    many = cj.identify_many(SCENE, STATE, draws, PARAMETERS, **options)
    assert many[0].estimates == fit.estimates
    assert many[1].estimates == fitted(draws[1], guess=CLOSE).estimates
    assert len({one.estimates["clearance"] for one in many}) == 3
    inside = [
        abs(one.coordinates[k] - truth) / np.sqrt(one.covariance[k, k])
        for one in many
        for k, truth in enumerate(true_coordinates())
    ]
    assert max(inside) < 4.0


def test_fit_in_labels_and_units(fit, draws):
    assert fit.units == {"young": "Pa", "restitution": "1", "clearance": "m"}
    assert fit.samples == 120 and fit.degrees_of_freedom == 117
    squares = sum(np.sum(row**2) for row in fit.residuals.values())
    assert fit.chi_squared == pytest.approx(squares, rel=1e-9)
    (warning,) = fit.warnings
    assert warning.startswith("The data hardly determine the combination +1 young +0.00")
    assert 0.001 < fit.p_value < 0.999
    fitted_clearance, _ = cj.parameters(fit.scene)["joints['shoulder'].clearance"]
    assert fitted_clearance == pytest.approx(fit.estimates["clearance"])
    for name, (low, high) in fit.intervals.items():
        assert low < fit.estimates[name] < high
    assert fit.intervals["restitution"][1] < 1.0
    assert "restitution" in str(fit) and "converged" in str(fit)


def test_starts_and_windows(fit, draws):
    reported = []
    starts = cj.Starts(2, {"clearance": 0.02, "young": 0.2}, seed=1)
    options = {"grow": (0.02,), "starts": starts, "progress": reported.append}
    found = fitted(draws[0], guess=[CLOSE, TRUTH], **options)
    assert len(found.searches) == 3
    rows = np.array([search.start for search in found.searches])
    np.testing.assert_allclose(rows[1], true_coordinates())
    np.testing.assert_array_less(np.abs(rows[2] - rows[0]), [0.2, 1e-12, 0.02])
    assert rows[2, 0] != rows[0, 0]
    assert [window.end_time for window in found.best.windows] == [0.02, END]
    assert len(reported) == sum(search.evaluations for search in found.searches)
    assert found.chi_squared == min(search.best.chi_squared for search in found.searches)
    assert found.chi_squared == pytest.approx(fit.chi_squared, abs=1e-3)


def test_minimum_of_an_objective(clean):
    """The median-like sum of magnitudes, which no least squares gives, falls towards the truth."""
    scene = cj.set_value(SCENE, PARAMETERS["clearance"].variation.path, 0.505e-3)
    data = {name: clean[name].values for name in PROBES}

    def objective(found):
        return sum(jnp.sum(jnp.abs(found[name] - data[name])) for name in PROBES) / 1e-4

    def minimised(objective, times=TIMES, **options):
        return cj.minimise(scene, STATE, objective, PARAMETERS, PROBES, times, **options)

    found = minimised(objective, iterations=12)
    assert found.result == cj.RESULTS.successful and found.history.shape == (12,)
    assert found.objective == found.history.min() < 0.5 * found.history[0]
    with pytest.raises(ValueError, match="`parameters` must be parameters for which the first run"):
        minimised(objective, settings=replace(cj.presets.derivatives, max_steps=3))

    def rooted(found, first=found.history[0]):
        return jnp.sqrt(2.0 * first - objective(found))  # NaN far from the truth

    short = minimised(rooted, iterations=3)
    assert short.history.shape == (1,) and short.objective == short.history[0]
    with pytest.raises(ValueError, match="`objective` must be finite in the first run, but is nan"):
        minimised(lambda found: -jnp.sqrt(-objective(found)))
    with pytest.raises(ValueError, match=r"`objective` must be of shape \(\), but is \(60,\): sum"):
        minimised(lambda found: found["x"])
    with pytest.raises(ValueError, match="`times` must be a rising one-dimensional array"):
        minimised(objective, [])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"guess": {"mass": 1.0}}, r"`guess` must be values of estimated .*\['mass'\]: name .*y"),
        ({"guess": []}, r"`guess` must be at least one start, but is \[\]: leave it out"),
        ({"guess": {"restitution": 1.2}}, "Parameter 'restitution': Argument `value` .* 0 and 1"),
        ({"guess": {"clearance": -1.0}}, "Parameter 'clearance': .*must be positive, but is -1.0"),
        ({"grow": (0.02, 0.01)}, "`grow` must be rising times between the first sample, 0.0"),
        ({"grow": (0.03,)}, r"and the last, 0.03 s, but is \(0.03,\): leave out the time"),
        ({"grow": "10 ms"}, "`grow` must be a number or an array of numbers, but is '10 ms'"),
        ({"starts": 3}, r"`starts` must be Starts, a Screening or None, but is 'int'"),
        ({"start_time": 0.03}, r"`measurements` must be later than the start of the run, 0.03 s"),
        ({"max_iterations": 0}, "`max_iterations` must be a whole .* but is 0: allow one run"),
        ({"check_runs": 10}, "`check_runs` must be None, 0, or a whole number from 50, but is 10"),
        ({"tolerance": 0.0}, "`tolerance` must be positive, but is 0.0: 1e-3 standard deviations"),
        ({"starts": cj.Starts(2, {"mass": 1.0})}, r"`spread` must be values of .*\['mass'\]"),
    ],
)
def test_options_that_no_fit_can_use(options, message, clean):
    with pytest.raises(ValueError, match=message):
        fitted(clean, **options)


def test_arguments_that_no_fit_can_use(clean):
    with pytest.raises(ValueError, match=r"`parameters` must be at least one Parameter, but is {}"):
        cj.identify(SCENE, STATE, clean, {}, progress=False)
    with pytest.raises(ValueError, match="`measurements` must be not empty, but is 0"):
        cj.identify_many(SCENE, STATE, [], PARAMETERS)
    other = cj.Measurements({"x": clean["x"]})
    with pytest.raises(
        ValueError, match=r"`measurements\[1\]` must be measurements of the same channels and times"
    ):
        cj.identify_many(SCENE, STATE, [clean, other], PARAMETERS)
    elbow = cj.Series(cj.quantities.JournalOffset("elbow", "x"), TIMES, TIMES, NOISE)
    with pytest.raises(ValueError, match="Series 'probe': .*elbow"):
        cj.identify(SCENE, STATE, cj.Measurements({"probe": elbow}), PARAMETERS)


@pytest.mark.filterwarnings("ignore::clearjoint.PoorFitWarning")
def test_windows_of_a_record_that_begins_late():
    """After hours, advised windows have a sample, and a window without any is refused."""
    spring = cj.SpringDamper("ground", "ball", (0, 0, 0), (0, 0, 0), stiffness=100.0)
    scene = cj.Scene({"ball": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}, forces={"spring": spring})
    state, start = cj.State({"ball": cj.body_state((0.1, 0, 0))}), 50000.0
    times = start + np.linspace(0.1, 3.0, 60)
    rows = times, 0.1 * np.cos(10.0 * (times - start)), 1e-4
    x = cj.Series(cj.quantities.Position("ball", "x"), *rows)
    free = {"k": cj.Parameter(lambda scene: scene.forces["spring"].stiffness, cj.Log())}

    def found(**options):
        data, quiet = cj.Measurements({"x": x}), {"check_runs": 0, "progress": False}
        return cj.identify(scene, state, data, free, start_time=start, **quiet, **options)

    advice = " ".join(found(guess={"k": 160.0}, max_iterations=1).advice)
    ends = [float(end) for end in advice.split("grow=(")[1].split(")")[0].split(", ")]
    assert found(guess={"k": 160.0}, grow=ends).estimates["k"] == pytest.approx(100.0, rel=1e-4)
    with pytest.raises(ValueError, match=r"`grow` must be rising .* first sample, 50000.1 s"):
        found(grow=(50000.05,))
