"""The largest value that keeps limits, for given margins and for a drop with a closed form."""

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import clearjoint as cj
from clearjoint._sweeps.largest import (
    LaneMargins,
    _Search,
    as_reduction,
    first_violation,
    lane_margins,
    limit_margins,
)
from clearjoint.quantities import ContactForce, Eccentricity
from tests.support.one_body import bearing, one_body

MASS, GRAVITY, STIFFNESS = 7.0, 9.81, 1e8
LARGEST = {"eccentricity": 0.5e-3, "force": 150.0}


def row(coordinates, margins):
    margins = np.asarray(margins, float)
    return LaneMargins(np.asarray(coordinates, float), margins, margins, margins)


def searched(function, tolerance=1e-3, lanes=10, between=(1.0, 10.0), plain=None):
    """Result between two values on a linear scale, for margins given by a function; and the rows
    that were computed."""
    rows = []

    def margins_by(function):
        def run(coordinates):
            rows.append(coordinates)
            return row(coordinates, [function(x) for x in coordinates])

        return run

    parameter = cj.Parameter(lambda scene: scene.gravity[0])
    confirming = None if plain is None else margins_by(plain)
    search = _Search(margins_by(function), lanes, tolerance, parameter, confirming)
    return search.run(*between, "m"), rows


@pytest.mark.parametrize(
    "function",
    [
        lambda x: 1.0 if x < 4.2345 else -1.0,
        lambda x: 1.0 if x < 4.2345 else -np.inf,
        lambda x: np.log(4.2345 / x),
    ],
    ids=["jumps", "fails", "passes zero"],
)
def test_rows_narrow_where_a_margin(function):
    found, rows = searched(function)
    assert found.met and found.monotone
    low, high = found.interval
    assert found.value == low <= 4.2345 <= high <= low * 1.001
    assert len(rows) <= 5


@pytest.mark.parametrize("seed", range(5))
def test_the_answer_keeps_the_limit_in_a_plain_run(seed):
    """Plain runs with larger errors, which are another number at each value."""

    def error(x):
        return 0.02 * np.random.default_rng(np.array([seed, hash(x) % 2**32])).standard_normal()

    def plain(x):
        return np.log(4.2345 / x) + error(x)

    found, rows = searched(lambda x: np.log(4.2345 / x), plain=plain)
    assert plain(found.value) >= 0.0 and found.value == pytest.approx(4.2345, rel=0.05)
    assert found.interval[0] == found.value <= found.interval[1] and len(rows) < 40
    with pytest.raises(ValueError, match=r"`between\[0\]` must be a value that satisfies the lim"):
        searched(lambda x: 5.0 - x, plain=lambda x: -1.0)


def test_a_tolerance_below_rounding_errors_ends_at_neighbouring_floats():
    limit = 1.23456789012345  # more digits than those of a value without rounding errors
    found, rows = searched(lambda x: 1.0 if x < limit else -1.0, tolerance=1e-17)
    assert found.interval == (np.nextafter(limit, 0.0), limit)
    assert len(rows) < 30


@pytest.mark.parametrize("between", [(-1.0, 1.0), (0.0, 1.0), (-1.0, 0.0)])
def test_a_violation_that_begins_beside_zero_is_found_in_few_rows(between):
    least = 0.0 if between[1] == 0.0 else 5e-324
    found, rows = searched(lambda x: 1.0 if x < least else -1.0, between=between)
    low, high = found.interval
    assert low <= 0.0 <= high and high - low < 1e-5 and len(rows) < 12


def test_the_first_violation_counts_and_later_passes_are_reported():
    """A violation below the first one of the first row."""
    found, _ = searched(lambda x: -1.0 if 4.2 < x < 4.6 or x > 5.5 else 1.0)
    assert found.value == pytest.approx(4.2, rel=1e-3) and not found.monotone
    first, last = found.alternating
    assert found.interval[1] == first and last == pytest.approx(5.5, rel=0.1)
    assert "passes and violations alternate" in str(found) and "Margins rise and fall" in str(found)
    assert f"by runs at {len(found.values)} values." in str(found)


@pytest.mark.parametrize("count", [8, 16, 32])
def test_a_narrow_violation_below_the_one_that_a_row_sees(count):
    """Margins of an acceleration of a slider-crank, by clearance in um: within 1.7 % or less of the
    limit, with a violation 0.9 % wide at 10 um and a pass up to 10.37 um above it."""
    clearances = [5.0, 6.4, 7.2, 8.7, 9.24, 9.82, 9.865, 9.905, 9.953, 9.965, 10.0, 10.03, 10.05]
    margins = [24.1, 26.6, 11.5, 10.2, 13.5, 8.4, 29.5, 7.9, 0.0, -0.6, -1.7, -1.6, -0.6]
    clearances += [10.068, 10.11, 10.151, 10.193, 10.235, 10.277, 10.319, 10.361, 10.446, 11.0]
    margins += [0.9, 7.8, 22.3, 24.2, 12.3, 5.3, 1.8, -0.1, -5.7, -26.0]
    found, rows = searched(
        lambda x: np.interp(x, clearances, margins) / 1e3 - max(0.0, x - 11.0) / 200.0,
        lanes=count,
        between=(5.0, 50.0),
    )
    assert found.value == pytest.approx(9.953, rel=1.5e-3) and not found.monotone
    assert found.interval[0] <= 9.953 <= found.interval[1]
    assert found.alternating[1] > 10.1 and len(rows) < 16


def test_a_violation_that_no_lane_of_the_first_row_sees():
    """The margin rises and falls over the lanes, and is negative between two of them."""
    found, _ = searched(lambda x: 0.03 * abs(x - 5.55) - 0.005)
    assert found.met and found.value == pytest.approx(5.55 - 1 / 6, rel=1e-3)
    assert found.alternating[1] == 10.0


def test_a_range_without_a_limit_and_one_beyond_it():
    found, _ = searched(lambda x: 1.0 / x)
    assert (found.value, found.met, found.interval) == (10.0, False, (10.0, 10.0))
    assert "No limit is reached up to 10 m" in str(found)
    with pytest.raises(
        ValueError, match=r"`between\[0\]` must be a value that satisfies the limits, but is 1.0"
    ):
        searched(lambda x: -1.0)


def test_quantiles_are_order_statistics_with_intervals_of_the_stated_confidence():
    """Of 2000 sets of draws of a uniform peak, the interval has the quantile in 95 % and more."""
    drawn = np.random.default_rng(0).uniform(size=(2000, 40))
    margin, low, high = limit_margins(drawn, 1.0, 0.8)
    assert np.all((low <= margin) & (margin <= high))
    assert np.all(np.isin(np.exp(-margin).round(12), drawn.round(12)))
    inside = np.mean((low <= -np.log(0.8)) & (-np.log(0.8) <= high))
    assert 0.94 < inside < 0.99
    margin, low, high = limit_margins(drawn, 1.0, 1.0)
    np.testing.assert_allclose(margin, -np.log(drawn.max(axis=1)))
    margin, low, _ = limit_margins(drawn[:, :4], 1.0, 0.95)
    assert np.all(low == -np.inf) and np.all(margin == -np.log(drawn[:, :4].max(axis=1)))


def test_rows_are_put_in_order():
    both = row([1.0, 3.0], [3.0, -1.0]).with_others(row([2.0, 3.0], [np.nan, 5.0]))
    np.testing.assert_array_equal(both.coordinates, [1.0, 2.0, 3.0])
    assert both.margins[2] == -1.0 and first_violation(both.margins) == 1 and both.falls(0.0)
    assert not row([1.0, 2.0], [1.0, 1.1]).falls(0.05) and row([1.0, 2.0], [1.0, 1.1]).falls(0.2)


def test_intervals_beside_infinite_margins_are_judged_without_warning():
    margins = row([1.0, 2.0, 3.0, 4.0], [np.inf, np.inf, 1.0, -1.0])
    with np.errstate(invalid="raise"):
        np.testing.assert_array_equal(margins.doubtful(), [False, True, True])


MISTAKEN = {
    "no parameter": ({"parameter": None}, "`parameter` must be a Parameter, but is 'NoneType'"),
    "a range that falls": ({"between": (1e-3, 1e-4)}, "`between` must be two rising values"),
    "a limit below zero": ({"limit": -1.0}, "`limit.'quantity'.` must be positive, but is -1.0"),
    "an infinite limit": ({"limit": np.inf}, "`limit.'quantity'.` must be finite, but is inf"),
    "a limit as text": ({"limit": "1 N"}, "`limit.'quantity'.` must be a number"),
    "no quantities": ({"quantity": {}, "limit": {}}, "`quantity` must be one or more"),
    "an array as limit, but two lanes": ({"limit": jnp.array(1e3), "lanes": 2}, "`lanes` must be"),
    "a limit of another": ({"limit": {"x": 1.0}}, "`limit` must be one for each of .'quantity'."),
    "a quantity by name": ({"quantity": "force"}, "`quantity.'quantity'.` must be a scalar"),
    "several results": (
        {"quantity": cj.Statistics(ContactForce("shoulder", "V"), "N")},
        'must be a reduction with a main result, named "", but is .*mean',
    ),
    "another joint": ({"quantity": ContactForce("elbow")}, "`joint` must be one of the scene's"),
    "a quantile": ({"quantile": 95.0}, r"`quantile` must be in \[0.0, 1.0\]"),
    "draws with the name of the axis": (
        {"draws": {"largest_value": cj.Axis(lambda scene: scene.gravity[0], [0.0])}},
        "`draws` must be axes of other names than 'largest_value'",
    ),
    "draws of the parameter": (
        {"draws": {"x": cj.Axis(lambda scene: scene.joints["shoulder"].clearance, [1e-4])}},
        r"`draws` must be each of another number, but is \['largest_value', 'x'\]",
    ),
    "two lanes": ({"lanes": 2}, "`lanes` must be at least 3"),
    "a tolerance": ({"tolerance": 0.0}, "`tolerance` must be positive"),
}


@pytest.mark.parametrize("case", MISTAKEN)
def test_unsupported_arguments_are_refused(case):
    changed, message = MISTAKEN[case]
    scene, state = cj.mechanisms.double_pendulum()
    usual = {
        "parameter": cj.Parameter(lambda scene: scene.joints["shoulder"].clearance, cj.Log()),
        "quantity": ContactForce("shoulder", "V"),
        "limit": 1e3,
        "between": (1e-4, 1e-3),
    }
    with pytest.raises(ValueError, match=message):
        cj.largest_feasible(scene, state, 0.01, **(usual | changed))


@pytest.fixture(scope="module")
def drop():
    """A mass that falls in its bearing, without damping: scene and state."""
    pin = bearing(cj.laws.Hertz(STIFFNESS), "mass", clearance=0.3e-3)
    body = {"mass": MASS, "inertia": (1e-2, 1e-2, 1e-2), "gravity": (0.0, -GRAVITY, 0.0)}
    return one_body("mass", {"pin": pin}, **body)


RANGE = {"between": (0.05e-3, 1e-3)}
OUTPUTS = {"eccentricity": Eccentricity("pin"), "force": ContactForce("pin", "V")}
CLEARANCE = cj.Parameter(lambda scene: scene.joints["pin"].clearance, cj.Log())


@pytest.mark.parametrize(
    ("eccentricity", "force", "result", "message"),
    [
        (1e-4, 300.0, "successful", "`force` reaches 300 N with this value, and its limit is 150"),
        (1e-4, np.nan, "successful", "`force` has no peak with this value, but NaN"),
        (np.nan, 300.0, "successful", "`eccentricity` has no peak with this value, but NaN"),
        (1e-4, np.inf, "successful", "`force` reaches inf N with this value"),
        (1e-4, 300.0, "max_steps_reached", "the run with this value fails"),
    ],
)
def test_a_violation_at_the_first_value_is_explained(eccentricity, force, result, message):
    def run(axes, outputs, zipped):
        peaks = {"eccentricity": eccentricity, "force": force}
        peaks["result"] = cj.extend.result_number(getattr(cj.RESULTS, result))
        return xr.Dataset({name: ("lane", [peak, peak]) for name, peak in peaks.items()})

    outputs = {name: as_reduction(one, None) for name, one in OUTPUTS.items()}
    found = lane_margins(run, CLEARANCE, outputs, LARGEST, {}, 1.0, np.log([1e-4, 2e-4]))
    assert found.peak.startswith(message) and first_violation(found.margins) == 0


def clearance_for(force, speed=0.0):
    """With which a mass that starts at a speed, m/s, presses on each base with a force, N: at the
    lowest point m g (c + d) + m v^2 / 2 = 2 (2/5) K d^(5/2), and a base's force is K d^(3/2)."""
    depth = (force / STIFFNESS) ** (2.0 / 3.0)
    return 0.8 * STIFFNESS * depth**2.5 / (MASS * GRAVITY) - depth - 0.5 * speed**2 / GRAVITY


@pytest.mark.slow
def test_largest_clearance_of_a_drop_is_the_closed_form(drop):
    """For either limit, and for both."""
    allowed = LARGEST["eccentricity"]
    eccentricity = allowed - (1.25 * MASS * GRAVITY * allowed / STIFFNESS) ** 0.4
    expected = {"eccentricity": eccentricity, "force": clearance_for(LARGEST["force"])}
    for names in (["eccentricity"], ["force"], list(LARGEST)):
        outputs, limits = ({name: of[name] for name in names} for of in (OUTPUTS, LARGEST))
        options = {"settings": cj.presets.derivatives, "tolerance": 1e-7}
        found = cj.largest_feasible(*drop, 0.03, CLEARANCE, outputs, limits, **RANGE, **options)
        exact = min(expected[name] for name in names)
        assert found.monotone and found.value == pytest.approx(exact, rel=1e-7)
        assert found.interval[0] <= exact * (1 + 1e-7) and exact <= found.interval[1] * (1 + 1e-7)


@pytest.mark.slow
def test_a_quantile_of_draws_is_that_of_their_closed_forms(drop):
    """Speeds at the start scatter; four of five must keep the force. Peaks count from the first
    impact on."""
    speeds = -np.linspace(0.0, 0.02, 10)
    draws = {"speed": cj.Axis.initial(lambda s: s.bodies["mass"].velocity[1], speeds)}
    options = RANGE | {"after": 1e-4, "draws": draws, "quantile": 0.8}
    found = cj.largest_feasible(
        *drop, 0.03, CLEARANCE, OUTPUTS["force"], LARGEST["force"], **options
    )
    assert found.met and found.monotone
    exact = clearance_for(LARGEST["force"], speeds[7])
    assert found.value == pytest.approx(exact, rel=1e-3) and found.value <= exact * (1 + 1e-6)
    low, high = found.interval
    assert low < clearance_for(LARGEST["force"], speeds[9]) * 1.05 and high > exact
