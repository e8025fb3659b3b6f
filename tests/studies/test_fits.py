"""The study of fits: its statistics, its searches with and without derivatives, and quick runs."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import clearjoint as cj
from studies.fits import baselines, draws
from studies.fits.__main__ import main
from studies.fits.draws import Recovery, Trial
from studies.fits.problem import PARAMETERS, STARTS, TRUTH, WINDOWS, coordinates, ideal
from studies.fits.scipy_fit import fit, probes


def attempt(offset: float, half: float, warnings: list[str], chi_squared: float = 0.0) -> Any:
    """A fit whose intervals are off the truth and wide by fractions of it."""
    intervals = {
        name: (value * (1 + offset - half), value * (1 + offset + half))
        for name, value in TRUTH.items()
    }
    found = SimpleNamespace(intervals=intervals, warnings=warnings, chi_squared=chi_squared)
    return SimpleNamespace(found=found, runs=3, seconds=0.5, screening=7)


def test_statistics_of_fits_leave_out_those_that_went_astray():
    errors = np.array([[1.0, 2.0, 0.0], [-1.0, 0.0, 1.0], [3.0, 4.0, 2.0], [0.0, 0.0, -6.0]])
    attempts = [attempt(0.0, 0.1, []), attempt(0.2, 0.1, ["a"]), attempt(-0.2, 0.1, ["b"])]
    found = Recovery("label", (*attempts, attempt(0.0, 0.1, ["Not converged"])), errors)
    assert found.astray.tolist() == [False, False, False, True]
    assert found.warned == 1
    np.testing.assert_allclose(found.scatter, [2.0, 2.0, 1.0])
    np.testing.assert_allclose(found.bias, np.sqrt(3.0) * np.array([0.5, 1.0, 1.0]))
    np.testing.assert_allclose(found.coverage, 1.0 / 3.0)
    cells = found.cells()
    assert cells[:5] == ("label", "4", "1", "1", "2.00, 2.00, 1.00")
    assert len(cells) == len(draws.HEAD)


def test_scipy_with_differences_finds_what_made_the_data():
    times, truth = np.arange(1, 151) * 1e-4, coordinates(TRUTH)
    values, scales = probes(list(TRUTH.values()), times), baselines.SCALES
    eccentricities = np.hypot(values[0::2], values[1::2])
    assert 0.49e-3 < eccentricities.max() < 0.51e-3
    start = truth + np.array([0.05, -0.05, 0.005])
    found = fit(times, values, 5e-6, list(scales.values()), start, [0.0125, times[-1]], 1e-6)
    np.testing.assert_allclose(found.coordinates, truth, rtol=1e-4)
    assert found.runs > 8


@pytest.mark.slow
def test_scipy_with_differences_ends_where_identify_does():
    data = baselines.problem(0.03)
    start = baselines.starts(0.02, 1)[0]
    derivatives, differences = data.identify(start, False), data.least_squares(start, False, 1e-6)
    apart = np.abs(derivatives.coordinates - differences.coordinates) / data.bounds
    assert apart.max() < 0.1
    assert derivatives.runs < differences.runs


@pytest.mark.slow
def test_draws_fitted_from_the_truth_do_not_go_astray():
    (found,) = draws.recoveries("probes", [Trial("probes", "truth", "at once", 2)], 0.03)
    assert found.label == "probes, truth, at once" and len(found.attempts) == 2
    assert not found.astray.any()


@pytest.mark.slow
def test_quick_horizon_is_predicted_and_drawn(tmp_path, capsys):
    main(["horizon", "--quick", "--output", str(tmp_path)])
    assert "predicted, ms" in capsys.readouterr().out
    assert (tmp_path / "horizon.png").stat().st_size > 5000


@pytest.mark.slow
@pytest.mark.parametrize("start", STARTS)
def test_screening_finds_the_parameters_from_far_starts(start):
    clean, bounds = ideal("accelerometers", 0.1)
    found = draws.recover(clean, bounds, Trial("accelerometers", start, "screened", 1), 0.1)
    assert not found.astray.any()
    assert found.attempts[0].found.warnings == []


@pytest.mark.slow
def test_growing_windows_fit_five_horizons():
    """The record has 0.187 s; a single run can fit 37 to 114 ms (test_horizon)."""
    clean, _ = ideal("probes", 0.187)
    found = cj.identify(
        *cj.mechanisms.double_pendulum(),
        clean.with_noise(np.random.default_rng(0)),
        PARAMETERS,
        replace(cj.presets.derivatives, rtol=1e-10),
        guess=STARTS["stiff, wide"],
        grow=[*WINDOWS, *np.arange(0.1, 0.187, 0.01)],
        check_runs=0,
        progress=False,
    )
    assert 0.95 < found.chi_squared / found.samples < 1.1
    for name, value in TRUTH.items():
        assert abs(found.estimates[name] - value) < 4.0 * found.standard_errors[name]
    assert found.standard_errors["young"] < 1e-3 * TRUTH["young"]
