"""Statistics of recovered parameters, and the fits that they and today's tools make."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import clearjoint as cj
from studies.common.baselines.scipy_fit import fit, probes
from studies.common.identification_problem import (
    PARAMETERS,
    STARTS,
    TRUTH,
    WINDOWS,
    coordinates,
    ideal,
)
from studies.identification import today as identification_today
from studies.recovery import coverage
from studies.recovery import draws as recovery
from studies.recovery.__main__ import main
from studies.recovery.draws import Recovery


def attempt(offset: float, half: float, warnings: list[str], chi_squared: float = 0.0) -> Any:
    """A fit whose intervals lie around the truth, off and wide by parts of it."""
    intervals = {
        name: (value * (1 + offset - half), value * (1 + offset + half))
        for name, value in TRUTH.items()
    }
    found = SimpleNamespace(intervals=intervals, warnings=warnings, chi_squared=chi_squared)
    return SimpleNamespace(found=found, runs=3, seconds=0.5, screening=7)


def test_statistics_of_fits_leave_out_those_that_went_astray():
    errors = np.array([[1.0, 2.0, 0.0], [-1.0, 0.0, 1.0], [3.0, 4.0, 2.0], [0.0, 0.0, -6.0]])
    attempts = [attempt(0.0, 0.1, []), attempt(0.2, 0.1, ["a"]), attempt(-0.2, 0.1, ["b"])]
    found = Recovery((*attempts, attempt(0.0, 0.1, ["Not converged"])), errors)
    assert found.astray.tolist() == [False, False, False, True]
    assert found.told == 1
    np.testing.assert_allclose(found.scatter, [2.0, 2.0, 1.0])
    np.testing.assert_allclose(found.bias, np.sqrt(3.0) * np.array([0.5, 1.0, 1.0]))
    np.testing.assert_allclose(found.coverage, 1.0 / 3.0)
    cells = recovery.row("label", found).split(" | ")
    assert cells[1:4] == ["4", "1", "1"] and cells[4] == "2.00, 2.00, 1.00"


def test_lower_minima_are_counted_draw_by_draw():
    near = Recovery(tuple(attempt(0.0, 0.1, [], 9.0) for _ in range(4)), np.zeros((4, 3)))
    found = tuple(attempt(0.0, 0.1, [], value) for value in (9.0, 8.0, 5.5))
    errors = np.array([[9.0, 0.0, 0.0], [0.0, -2.0, 1.0], [0.0, 1.0, -3.0]])
    text = recovery.lower(Recovery(found, errors), near)
    assert text.endswith("in 2 of 3 draws, by 1 to 3.5, 2.5 bounds off (median; at most 3.0)")
    assert recovery.lower(near, near).endswith("in 0 of 4 draws")


def test_starts_cover_what_the_issue_asks():
    for sign, limits in ((-1.0, (41.4e9, 0.6, 0.5e-3 / 1.2)), (1.0, (1035e9, 27 / 28, 0.6e-3))):
        corner = coordinates(TRUTH) + sign * identification_today.SPREAD
        pairs = zip(PARAMETERS.values(), corner, strict=True)
        found = [float(parameter.scale.value(u)) for parameter, u in pairs]
        assert found == pytest.approx(limits, rel=0.02)


def test_scipy_with_differences_finds_what_made_the_data():
    times, truth = np.arange(1, 151) * 1e-4, coordinates(TRUTH)
    values, scales = probes(list(TRUTH.values()), times), identification_today.SCALES
    eccentricities = np.hypot(values[0::2], values[1::2])
    assert 0.49e-3 < eccentricities.max() < 0.51e-3
    start = truth + np.array([0.05, -0.05, 0.005])
    found = fit(times, values, 5e-6, list(scales.values()), start, [0.0125, times[-1]], 1e-6)
    np.testing.assert_allclose(found.coordinates, truth, rtol=1e-4)
    assert found.runs > 8


@pytest.mark.slow
def test_scipy_with_differences_ends_where_identify_does():
    data = identification_today.problem(0.03)
    start = identification_today.starts(0.02, 1)[0]
    ours, theirs = data.identified(start, False), data.by_differences(start, False, 1e-6)
    apart = np.abs(ours.coordinates - theirs.coordinates) / data.bounds
    assert apart.max() < 0.1
    assert ours.runs < theirs.runs


def test_coverage_counts_minima_intervals_and_misses():
    found = [
        coverage.Draw((True, True), (True, True), (0.0, 0.0), False, (1.0, 2.0)),
        coverage.Draw((False, True), (True, True), (160.0, -0.1), True, (3.0, 4.0)),
        coverage.Draw((False, False), (False, True), (9.0, 5.0), True, (5.0, 6.0)),
        coverage.Draw((False, True), (False, True), (0.0, 0.0), False, (5.0, 6.0)),
    ]
    cells = [cell.strip() for cell in coverage.row("pin", found).split("|")[1:-1]]
    assert cells == ["pin", "4", "2; 1", "25, 75", "50, 100", "2", "2, 1", "4; 5"]
    assert len(cells) == len(coverage.HEADINGS)


@pytest.mark.slow
def test_quick_coverage_prints_a_row(capsys):
    main(["coverage", "--quick"])
    cells = [cell.strip() for cell in capsys.readouterr().out.splitlines()[-1].split("|")]
    assert cells[1] == "crank-rocker, rocker foot, from 1.1 rad" and cells[2] == "2"


@pytest.mark.slow
def test_quick_recovery_prints_a_row(capsys):
    main(["--quick"])
    cells = [cell.strip() for cell in capsys.readouterr().out.splitlines()[-1].split("|")]
    assert cells[1] == "probes, truth, at once" and cells[2:4] == ["2", "0"]


@pytest.mark.slow
@pytest.mark.parametrize("start", STARTS)
def test_accelerometers_come_home_from_far_starts(start):
    clean, bounds = ideal("accelerometers", 0.1)
    found = recovery.recovery(clean, bounds, STARTS[start], "screened", 1, 0.1)
    assert not found.astray.any()
    assert found.attempts[0].found.warnings == []


@pytest.mark.slow
def test_growing_windows_fit_five_horizons():
    """Probes over 0.187 s, where a single run is lost after 37 to 114 ms (test_horizon)."""
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
