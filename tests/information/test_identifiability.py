"""Fisher information: against closed forms, and the bounds of an event-exact solver."""

import numpy as np
import pytest

import clearjoint as cj
from clearjoint.quantities import Position, Velocity
from studies.identifiability import instruments as study

TIMES = np.linspace(0.01, 1.0, 100)


def thrown() -> tuple[cj.Scene, cj.State]:
    """A free mass at 3 m/s upwards in gravity: x(t) = 3 t + g t^2/2."""
    scene = cj.Scene({"ball": cj.Body(1.0, (0.1, 0.1, 0.1))}, gravity=(0.0, -9.81, 0.0))
    return scene, cj.State({"ball": cj.body_state((0.0, 0.0, 0.0), velocity=(0.0, 3.0, 0.0))})


def launch(scale: cj.extend.AbstractScale | None = None) -> cj.Parameter:
    return cj.Parameter.initial(lambda s: s.bodies["ball"].velocity[1], scale)


GRAVITY = cj.Parameter(lambda s: s.gravity[1])
PARAMETERS = {
    "v": launch(cj.Linear(2.0)),
    "g": GRAVITY,
    "mass": cj.Parameter(lambda s: s.bodies["ball"].mass, cj.Log()),
}
HEIGHT = cj.Sensor(Position("ball", "y"), TIMES, 0.02)


@pytest.fixture(scope="module")
def report() -> cj.results.Identifiability:
    """Speed and gravity from the height, and from the speed; the mass from nothing."""
    sensors = {"height": HEIGHT, "speed": cj.Sensor([Velocity("ball", "y")], TIMES[:50], 0.1)}
    return cj.identifiability(*thrown(), PARAMETERS, sensors)


def expected(times: np.ndarray, noise: float) -> np.ndarray:
    """Covariance of v and g by least squares of heights."""
    rows = np.stack([times, times**2 / 2.0], axis=1) / noise
    return np.linalg.inv(rows.T @ rows)


def test_bounds_are_those_of_linear_least_squares(report):
    one = report.of("height")
    covariance = expected(TIMES, 0.02)
    deviations = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(one.value_deviations[:2], deviations, rtol=1e-6)
    np.testing.assert_allclose(one.deviations[0], deviations[0] / 2.0, rtol=1e-6)
    correlation = covariance[0, 1] / deviations.prod()
    found = np.linalg.inv(one.matrix[:2, :2])
    assert found[0, 1] / np.sqrt(found[0, 0] * found[1, 1]) == pytest.approx(correlation, rel=1e-6)
    alone = 0.02 / np.linalg.norm(TIMES**2 / 2.0)
    assert one.deviations_alone[1] == pytest.approx(alone, rel=1e-6)


def test_shorter_records_and_those_over_time(report):
    one = report.of("height")
    for count in (2, 50):
        until = np.sqrt(np.diag(expected(TIMES[:count], 0.02)))
        np.testing.assert_allclose(one.until(TIMES[count - 1]).value_deviations[:2], until, 1e-6)
        np.testing.assert_allclose(one.over_time()[count - 1, :2] * [2.0, 1.0], until, 1e-6)
    assert np.isinf(one.over_time()[0, :2]).all()


def test_sensors_add_their_information(report):
    both = np.linalg.inv(expected(TIMES, 0.02))
    rows = np.stack([np.ones(50), TIMES[:50]], axis=1) / 0.1
    deviations = np.sqrt(np.diag(np.linalg.inv(both + rows.T @ rows)))
    np.testing.assert_allclose(report.value_deviations[:2], deviations, rtol=1e-6)


def test_what_no_sensor_sees_is_not_identifiable(report):
    """A free mass falls as any other."""
    assert report.identifiable == {"v": True, "g": True, "mass": False}
    assert report.rank == 2
    assert np.isinf(report.deviations[2]) and np.isinf(report.condition)
    worst = report.combinations[-1]
    assert worst.described(report.labels) == "log mass"
    text = str(report)
    assert "log mass  " in text and "not determined" in text
    assert "mass is not identifiable: the standard deviation of log mass is infinite" in text


@pytest.mark.slow
def test_measured_series_serve_as_sensors(report):
    """By their channel, times and noise, whatever their values."""
    height = cj.Series(Position("ball", "y"), TIMES, np.zeros(100), noise=0.02)
    found = cj.identifiability(*thrown(), PARAMETERS, cj.Measurements({"height": height}))
    np.testing.assert_allclose(found.deviations, report.of("height").deviations)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: cj.Sensor("x", TIMES, 1.0), "`channels`"),
        (lambda: cj.Sensor(Position("ball", "y"), TIMES[::-1], 1.0), "`times`.*rising"),
        (lambda: cj.Sensor(Position("ball", "y"), [], 1.0), "`times`"),
        (lambda: cj.Sensor(Position("ball", "y"), TIMES, 0.0), "`noise`.*positive"),
        (lambda: cj.Sensor(Position("ball", "y"), TIMES, [1.0, 2.0]), "`noise`.*shape"),
        (lambda: _planned({}), "`sensors`"),
        (lambda: _planned({"a": 3.0}), r"`sensors\['a'\]`"),
        (lambda: _planned({"a": cj.Sensor(Position("bal", "y"), TIMES, 1.0)}), "'a'.*'bal'"),
    ],
)
def test_errors(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def _planned(sensors):
    return cj.identifiability(*thrown(), {"g": GRAVITY}, sensors)


def test_errors_of_reports(report):
    with pytest.raises(ValueError, match="'probe'"):
        report.of("probe")
    with pytest.raises(ValueError, match="`time`"):
        report.until(0.0)


@pytest.mark.slow
@pytest.mark.parametrize("column", [0, 1])
def test_bounds_of_the_pendulum_by_all_instruments(column):
    """To all the digits that are known: those of a solver in quadruple precision."""
    found = study.report(study.LENGTHS[column])
    for instrument, of_instrument in study.INSTRUMENTS.items():
        report, known = found.of(instrument), of_instrument.known[column]
        for name, deviation, text in zip(report.names, report.deviations, known, strict=True):
            assert report.identifiable[name] == bool(text), name
            if text:
                digits = len(text.split("e")[0].replace(".", "").lstrip("0"))
                assert float(f"{deviation:.{digits}g}") == float(text), (name, deviation, text)
