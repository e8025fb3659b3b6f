"""The study of a swinging pendulum, on small files in the same formats with known truth."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.io import savemat

from studies.real_pendulum import swing_fits
from studies.real_pendulum.__main__ import main
from studies.real_pendulum.fits import ALL, prepared, study
from studies.real_pendulum.pendulum import Pendulum
from studies.real_pendulum.swing_files import Swing, read_swings
from studies.real_pendulum.swing_fits import fit_frictions, identified, roughly

TRUTH = Pendulum(0.15, 1e-3, 3e-3, 5e-5, 2e-3, 0.3, 10.0)
NOISE = 2e-4


def swing(truth, times):
    """Return angles by SciPy from the equation of motion of a mathematical pendulum."""
    rate = 9.81 / truth.length

    def field(t, y):
        angle, speed = y
        friction = truth.viscous * speed + truth.coulomb * np.tanh(speed / 0.02)
        friction += truth.quadratic * speed * abs(speed)
        return speed, -rate * (np.sin(angle - truth.vertical) + friction)

    span, start = (times[0], times[-1]), (truth.angle, truth.speed)
    return solve_ivp(field, span, start, t_eval=times, rtol=1e-10, atol=1e-12, max_step=0.01).y[0]


@pytest.fixture(scope="module")
def recorded():
    """Return times and noisy angles of ten seconds."""
    times = np.arange(0.0, 10.0, 0.004)
    noise = NOISE * np.random.default_rng(3).standard_normal(len(times))
    return times, swing(TRUTH, times) + noise


@pytest.fixture(scope="module")
def pieces(recorded, tmp_path_factory):
    """A MATLAB file with two pieces for the fit and one for validation."""
    times, angles = recorded
    cells = {}
    for name, cuts in (("id", [(0, 900), (900, 1800)]), ("vad", [(1800, 2500)])):
        for key in ("Time", "Y"):
            cells[f"{key}_{name}"] = cell = np.empty((len(cuts), 1), dtype=object)
            for k, (a, b) in enumerate(cuts):
                both = np.stack([angles[a:b] + np.pi, 0 * angles[a:b]])
                cell[k, 0] = times[a:b, None] if key == "Time" else both
    path = tmp_path_factory.mktemp("swing") / "pieces.mat"
    savemat(path, cells)
    return path


@pytest.mark.slow
def test_true_friction_is_recovered_within_its_errors(pieces):
    first, _ = prepared(pieces, quick=False)
    rough = roughly(first)
    found = fit_frictions(first, rough, ("viscous", "coulomb", "quadratic"))
    assert found.rms == pytest.approx(NOISE, rel=0.15)
    assert abs(found.correlation) < 0.2
    for name in ("length", "viscous", "coulomb", "quadratic", "vertical"):
        difference = (getattr(found.pendulum, name) - getattr(TRUTH, name)) / found.errors[name]
        assert abs(difference) < 4.0, name
    assert found.errors["length"] < 2e-5 and found.errors["coulomb"] < 1e-3
    assert fit_frictions(first, rough, ("viscous",)).rms > 1.5 * NOISE
    other = identified(first, found, rough)
    assert other.ending is other.ending.CONVERGED
    for name in ("viscous", "coulomb", "quadratic", "vertical", "angle", "speed"):
        difference = other.estimates[name] - getattr(found.pendulum, name)
        assert abs(difference) < 0.02 * found.naive[name], name
        assert other.standard_errors[name] == pytest.approx(found.naive[name], rel=0.02), name


@pytest.mark.slow
def test_quick_study_predicts_the_validation_piece(pieces):
    fitted = study(prepared(pieces, quick=True))
    predicted_rms = {name: tests[0].rms for name, tests in fitted.tests.items()}
    assert predicted_rms[ALL] < 3.0 * NOISE < predicted_rms["viscous"]


@pytest.mark.slow
def test_quick_study_writes_its_figure(pieces, tmp_path, capsys):
    main([str(pieces), "--quick", "--output", str(tmp_path)])
    assert (tmp_path / "swings.png").stat().st_size > 5000
    assert ALL in capsys.readouterr().out


def test_standard_errors_allow_for_correlation():
    """The mean of residuals repeated ten times is as uncertain as that of a tenth of them."""
    generator = np.random.default_rng(4)
    residuals = np.repeat(generator.standard_normal(400), 10)
    (error,), (naive,) = swing_fits.standard_errors(np.ones((4000, 1)), residuals, 40)
    assert naive == pytest.approx(1 / np.sqrt(4000), rel=0.1)
    assert error == pytest.approx(1 / np.sqrt(400), rel=0.2)


def test_text_files_of_both_forms_are_read(recorded, tmp_path):
    times, angles = recorded
    degrees, columns = tmp_path / "one_column.txt", tmp_path / "columns.txt"
    head = "trigger_start_deg, sample_rate, duration_sec\n90, 250, 10 "
    np.savetxt(degrees, np.degrees(angles), "%.6f", header=head, comments="")
    (found,) = read_swings(degrees)
    np.testing.assert_allclose(found.times, times, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(found.angles, angles, rtol=0.0, atol=1e-8)
    rows = [(k, t, s * a, 0) for k, s in enumerate((1, -1)) for t, a in zip(*recorded, strict=True)]
    np.savetxt(columns, rows, " %d %.16e %.16e %d", header="%o v", comments="")
    one, two = read_swings(columns)
    np.testing.assert_array_equal(one.angles, angles)
    np.testing.assert_array_equal(two.angles, -angles)


def test_recording_of_one_swing_is_read(recorded, tmp_path):
    times, angles = recorded
    path = tmp_path / "recording.mat"
    signals = {"values": (angles + np.pi)[:, None]}
    savemat(path, {"Theta1": {"time": (60 + times)[:, None], "signals": signals}})
    (found,) = read_swings(path)
    np.testing.assert_allclose(found.times, times, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(found.angles, angles, rtol=0.0, atol=1e-12)


def test_a_swing_begins_at_the_vertical():
    angles = np.array([-1.0, -1.5, -1.0, -0.5, 0.5, 1.0, 0.5, -0.5])
    found = Swing("a", np.arange(8.0), angles).free()
    np.testing.assert_array_equal(found.times, [3.0, 4.0, 5.0, 6.0, 7.0])


def test_less_than_a_period_is_refused():
    with pytest.raises(ValueError, match="half passes its middle 1 times"):
        swing_fits.guess(Swing("half", np.arange(20.0), np.linspace(-1.0, 1.0, 20)))


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.txt", "time angle\n0 1\n", "neither|begins with 'time angle'"),
        ("a.txt", "%o v\n0 0 1 2\n0 1 1\n", "Row 3 .* has 3 numbers"),
        ("a.txt", "%o v\n" + "0 1 0.5 0\n" * 20, "not later than the one before"),
        ("a.txt", "%o v\n" + "".join(f"0 {k} 0.5 0\n" for k in range(20)), "it is no swing"),
        ("a.txt", "%o v\n" + "".join(f"0 {k} nan 0\n" for k in range(20)), "Sample 1 .* finite"),
        ("a.mat", "text", "not a MATLAB file"),
    ],
)
def test_files_without_a_swing_are_refused(tmp_path, name, text, said):
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=said):
        read_swings(tmp_path / name)
