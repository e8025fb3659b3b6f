"""Growth of differences, ways from wrong guesses, and the horizons of a fit by a single run."""

import warnings
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest

import clearjoint as cj
from clearjoint import plot
from clearjoint.quantities import JournalOffset
from tests.support.drawn_axes import legend
from tests.support.dropped_rod import dropped_rod

LAST = 0.04


def clearance(scene: cj.Scene):
    return scene.joints["pin"].clearance


START, PARAMETERS = dropped_rod(), {"clearance": cj.Parameter(clearance, cj.Log())}


@pytest.fixture(scope="module")
def found() -> cj.results.FitHorizon:
    times = np.linspace(0.0, LAST, 401)[1:]
    probe = [JournalOffset("pin", component=k, base="V") for k in "xy"]
    sensors = {"probe": cj.Sensor(probe, times, 5e-6)}
    return cj.fit_horizon(*START, PARAMETERS, sensors, uncertainty={"clearance": np.log(3.0)})


def test_growth_in_flight_is_that_of_free_motion(found):
    """Points move apart at 1 m/s, and some turning."""
    flight = found.times < 0.01
    late = found.growth[flight, 1] / found.times[flight]
    np.testing.assert_allclose(late, late[0], rtol=1e-3)
    assert (found.growth[flight, 0] == 0.0).all()


def test_a_short_run_is_within_all_horizons(found):
    assert found.numerical == np.inf
    assert 0.0 < found.error.max() < 1e-3 and 0.0 < found.derivative_error.max() < 1e-4
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found.warn_if_beyond(np.nextafter(min(LAST, found.single_shot), 0.0))


def test_the_warning_gives_numbers_and_the_remedy(found):
    with pytest.warns(UserWarning, match="ends at 30 ms.*from 20 ms on.*first ends before 20 ms"):
        replace(found, numerical=0.02).warn_if_beyond(0.03)
    # The record that ends with the first inaccurate sample is too long.
    limited = replace(found, numerical=0.005)
    with pytest.warns(UserWarning, match="ends at 5 ms.*from 5 ms on, integration errors"):
        limited.warn_if_beyond(0.005)


def test_the_report_names_limits_guesses_and_the_worth_of_longer_records(found):
    text = str(found)
    assert "A run of 40 ms" in text
    assert "log clearance" in text and "+1.1" in text and "-1.1" in text
    assert "40 ms" in text.splitlines()[-1]


def test_errors():
    probe = {"probe": cj.Sensor(JournalOffset("pin", "x"), [0.01], 5e-6)}
    with pytest.raises(ValueError, match="`parameters` must be at least one"):
        cj.fit_horizon(*START, {}, probe, uncertainty={})
    with pytest.raises(ValueError, match="`uncertainty`.*'clearance'"):
        cj.fit_horizon(*START, PARAMETERS, probe, uncertainty={})
    with pytest.raises(ValueError, match=r"`uncertainty\['clearance'\]`.*positive"):
        cj.fit_horizon(*START, PARAMETERS, probe, uncertainty={"clearance": 0.0})


@pytest.mark.slow
def test_horizons_of_the_double_pendulum():
    """Fits from a factor 5 in stiffness succeed at 55 ms and fail from 65 ms on, and those from the
    worst guess likewise (`studies/fits`). Rounding alone tells runs apart from 0.15 s on (the
    reference's README)."""
    from studies.identifiability.instruments import ACROSS, BASES
    from studies.identifiability.instruments import PARAMETERS as KNOWN

    probe = [JournalOffset("shoulder", component=k, base=base) for base in BASES for k in ACROSS]
    sensors = {"probe": cj.Sensor(probe, np.arange(1, 2001) * 1e-4, 5e-6)}
    between = cj.Bounded(0.0, 1.0)
    restitution = cj.Parameter(lambda s: s.joints["shoulder"].law.restitution, between)
    parameters = KNOWN | {"restitution": restitution}
    uncertainty = {"stiffness": np.log(5.0), "restitution": 1.8, "clearance": np.log(1.2)}
    start = cj.mechanisms.double_pendulum()
    found = cj.fit_horizon(*start, parameters, sensors, uncertainty=uncertainty)
    stiffer = next(g for g in found.guesses if (g.offsets > 0.0).tolist() == [True, False, False])
    assert 0.06 < stiffer.since < 0.075
    assert 0.03 < found.convergence < 0.045
    assert 0.15 < found.numerical < 0.2


def test_figures_have_labels_and_mark_what_is_limited(found):
    limited = replace(found, numerical=0.02)
    axes = plot.growth(limited)
    assert axes.get_ylabel() == "displacement, m"
    assert legend(axes) == ["log clearance", "initial velocity, m/s"]
    assert "integration fails" in [text.get_text() for text in axes.texts]
    assert plot.integration_error(limited).get_yscale() == "log"
    drawn = plot.record_length(found.information)
    assert drawn.get_xlabel() == "end of the record, ms"
    plt.close("all")
