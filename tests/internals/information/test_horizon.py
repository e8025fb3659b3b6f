"""Growth of differences, and ways from a guess to the truth."""

import inspect
from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint._fields.checks import conditions_of
from clearjoint._information import error_growth as growth
from clearjoint._information.horizon import PATH_POINTS, blocked_records, offsets
from clearjoint._math.smoothing import wrapped
from clearjoint.quantities import Angle
from tests.information import test_horizon
from tests.information.test_horizon import LAST, clearance
from tests.support.dropped_rod import dropped_rod

found = test_horizon.found


RADIUS = float(np.sqrt((0.1 + 2 * 0.5855) / (2 * 7.02)))
"""Of gyration, m."""


def _moved(state: cj.State, speed: float) -> cj.State:
    """All points get a velocity as in the disturbance."""
    push, rod = speed * np.array(growth.DIRECTION), state.bodies["rod"]
    return cj.State(
        {"rod": cj.BodyState(rod.position, rod.orientation, rod.velocity + push, push / RADIUS)}
    )


def _points(solution: cj.results.Solution, local: np.ndarray) -> np.ndarray:
    """(T, N, 3) points (N, 3) of the rod over time."""
    saved = solution.saved.states.bodies["rod"]
    rotation = Rotation.from_quat(saved.orientation, scalar_first=True).as_matrix()
    return np.asarray(saved.position)[:, None] + np.einsum("tij,nj->tni", rotation, local)


@pytest.mark.slow
def test_growth_is_that_of_two_neighbouring_runs(found):
    scene, state = dropped_rod()
    speed, how = 1e-8, (cj.Settings(rtol=1e-11), cj.Saving(found.times))
    local = np.concatenate([np.zeros((1, 3)), RADIUS * np.eye(3)])
    ends = [
        _points(cj.simulate(scene, _moved(state, sign * speed), LAST, *how), local)
        for sign in (1.0, -1.0)
    ]
    apart = np.linalg.norm((ends[0] - ends[1]) / (2.0 * speed), axis=2)
    measured = np.sqrt((apart**2).mean(axis=1))
    np.testing.assert_allclose(found.growth[:, 1], measured, rtol=1e-3)
    late = found.times >= 0.0101
    slope = np.polyfit(found.times[late], np.log(measured[late]), 1)[0]
    assert found.rate == pytest.approx(slope, rel=0.01)


@pytest.mark.slow
def test_the_way_is_closed_where_the_misfit_grows_towards_the_truth(found):
    """Against differences of the misfit itself, by runs of `simulate`."""
    scene, state = dropped_rod()
    journal = np.array([[-0.5, 0.0, -0.01]])

    def seen(logarithm: float) -> np.ndarray:
        other = cj.set_value(scene, clearance, 5e-4 * np.exp(logarithm))
        how = cj.Settings(rtol=1e-11), cj.Saving(found.times)
        run = cj.simulate(other, state, LAST, *how, progress=False)
        return _points(run, journal)[:, 0, :2] / 5e-6

    truth, step = seen(0.0), 1e-6
    for guess in found.guesses:
        closed = np.zeros(len(found.times), bool)
        for share in np.linspace(0.0, 1.0, PATH_POINTS + 1)[1:]:
            near = [
                np.cumsum(((seen((share + s) * guess.offsets[0]) - truth) ** 2).sum(axis=1))
                for s in (step, -step)
            ]
            closed |= (near[0] < near[1] * (1.0 - 1e-9)) & (near[0] > 1.0)
        assert (closed == guess.blocked).mean() > 0.98
        assert guess.since == (found.times[guess.blocked.argmax()] if closed.any() else np.inf)
    assert 0.02 < np.mean([guess.blocked for guess in found.guesses]) < 0.98


def test_ways_of_an_oscillation():
    """Frequency from sin(w t): closed where misfits by themselves rise towards the truth."""
    times = np.linspace(0.0, 10.0, 2001)
    true, off = 3.0, 1.2

    def misfits(w):
        return np.cumsum((1e3 * (np.sin(w * times) - np.sin(true * times))) ** 2)

    w = true + off
    seen, guessed = 1e3 * np.sin(true * times)[None], 1e3 * np.sin(w * times)[None]
    here = blocked_records(seen, guessed, 1e3 * off * times[None] * np.cos(w * times))
    step = 1e-6
    slopes = (misfits(w + step) - misfits(w - step)) / (2.0 * step)
    expected = (slopes < 0.0) & (misfits(w) > 1.0)
    assert 0.1 < expected.mean() < 0.9
    assert (here == expected).mean() > 0.999


def test_a_run_that_fails_closes_the_way():
    times = np.linspace(0.1, 1.0, 10)
    short = 1.1 * times[None, :4]
    closed = blocked_records(times[None], short, 0.1 * times[None, :4])
    assert closed.tolist() == [False] * 4 + [True] * 6


@pytest.mark.slow
def test_angles_that_pass_half_a_turn():
    """A free body turns past 180 degrees; a sensor counts angles modulo 1e-11 rad, far below the
    integration error."""

    class Remainder(Angle):
        period = 1e-11

        def __call__(self, now):
            return wrapped(super().__call__(now), self.period)

    turned = cj.body_state((0, 0, 0), cj.rotation((0, 0, 1), 3.0), spin=(0, 0, 10.0))
    scene, state = cj.Scene({"rod": cj.Body(1.0, (0.1,) * 3)}), cj.State({"rod": turned})
    parameters = {"spin": cj.Parameter.initial(lambda state: state.bodies["rod"].spin[2])}
    sensors = {
        "angle": cj.Sensor(Angle("rod", (0, 0, 1)), np.linspace(0.01, 0.1, 10), 1e-3),
        "remainder": cj.Sensor(Remainder("rod", (0, 0, 1)), np.linspace(0.5, 1.0, 50), 1e-12),
    }
    limits = cj.fit_horizon(scene, state, parameters, sensors, uncertainty={"spin": 5.0})
    assert not any(guess.blocked[:10].any() for guess in limits.guesses)
    assert 3.0 < limits.error.max() <= 5.0 * (1.0 + 1e-6)


def test_guesses_of_several_parameters():
    """Each alone both ways, and all corners of up to three."""
    two = np.array(list(offsets(np.array([1.0, 2.0]))))
    assert two.tolist() == [[1, 0], [-1, 0], [0, 2], [0, -2], [1, 2], [1, -2], [-1, 2], [-1, -2]]
    assert len(list(offsets(np.ones(1)))) == 2
    assert len(list(offsets(np.ones(5)))) == 10 + 8


@pytest.mark.slow
def test_the_warning_names_the_line_of_the_user(found):
    """Functions of the package, such as `identify`, call the method."""
    # Without the frame of the check of shapes, which only tests have.
    method = inspect.unwrap(type(found).warn_if_beyond)
    with pytest.warns(UserWarning, match="too long") as caught:
        conditions_of(partial(method, found, np.inf))
    assert caught[0].filename == __file__
