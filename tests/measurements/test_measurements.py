"""Series and their windows, residuals, units, and datasets."""

import math

import equinox as eqx
import jax
import numpy as np
import pytest

import clearjoint as cj
from clearjoint import quantities as q

PROBE = q.JournalOffset("shoulder", "x")
ANGLE = q.JointAngle("elbow")


def probe(**changes):
    """Three samples of a proximity probe, in µm."""
    options = {"times": [0.0, 0.1, 0.3], "values": [10.0, 20.0, -30.0], "noise": 2.0, "unit": "µm"}
    return cj.Series(PROBE, **(options | changes))


def test_series_are_stored_in_si():
    series = probe(noise=[1.0, 2.0, 4.0])
    np.testing.assert_allclose(series.values, [1e-5, 2e-5, -3e-5], rtol=1e-14)
    np.testing.assert_allclose(series.noise, [1e-6, 2e-6, 4e-6], rtol=1e-14)
    assert series.unit == "m"
    assert probe(unit=None).values[0] == 10.0
    own = cj.Series(lambda now: now.time, [0.0], [3.0], 1.0, unit="ms")
    assert (own.values[0], own.unit) == (pytest.approx(3e-3), "s")


def test_residuals_are_in_standard_deviations():
    found = probe().residuals(np.array([10e-6, 24e-6, -31e-6]))
    np.testing.assert_allclose(found, [0.0, 2.0, -0.5], rtol=0.0, atol=1e-12)


def test_residuals_of_angles_count_modulo_whole_turns():
    series = cj.Series(ANGLE, [0.0, 1.0, 2.0], [179.0, -1.0, 90.0], 0.5, unit="deg")
    predicted = np.deg2rad([-179.0, 721.0, 90.0 - 360.0])
    np.testing.assert_allclose(series.residuals(predicted), [4.0, 4.0, 0.0], rtol=0.0, atol=1e-10)
    slope = jax.jacfwd(series.residuals)(predicted)
    np.testing.assert_allclose(slope, np.eye(3) / np.deg2rad(0.5), rtol=1e-12)


def test_channel_is_no_data_to_jax():
    traces = []

    @eqx.filter_jit
    def compiled(series, prediction):
        traces.append(series)
        return series.residuals(prediction)

    np.testing.assert_allclose(compiled(probe(), np.zeros(3)), [-5.0, -10.0, 15.0], rtol=1e-12)
    other = probe(values=[0.0, 0.0, 4.0])
    np.testing.assert_allclose(compiled(other, np.zeros(3)), [0.0, 0.0, -2.0], rtol=1e-12)
    assert len(traces) == 1


def test_noise_has_the_given_spread():
    times = np.arange(20_000.0)
    noise = np.where(times < 10_000, 1.0, 3.0)
    series = cj.Series(PROBE, times, np.full(20_000, 7.0), noise, unit="mm")
    drawn = series.with_noise(np.random.default_rng(1))
    error = 1e3 * drawn.values - 7.0
    assert error[:10_000].std() == pytest.approx(1.0, rel=0.03)
    assert error[10_000:].std() == pytest.approx(3.0, rel=0.03)
    assert error.mean() == pytest.approx(0.0, abs=0.06)
    np.testing.assert_array_equal(drawn.noise, series.noise)
    both = cj.Measurements({"a": series, "b": series}).with_noise(np.random.default_rng(1))
    np.testing.assert_array_equal(both["a"].values, drawn.values)
    assert not np.array_equal(both["b"].values, drawn.values)


def together():
    elbow = cj.Series(ANGLE, [0.1, 0.2], [90.0, 91.0], 1.0, unit="deg")
    return cj.Measurements({"probe": probe(), "elbow": elbow})


def test_times_are_the_union():
    np.testing.assert_array_equal(together().times(), [0.0, 0.1, 0.2, 0.3])


def test_successive_windows_share_no_sample():
    whole = together()
    edges = [0.0, 0.1, 0.3, math.inf]
    windows = [whole.between(*pair) for pair in zip(edges, edges[1:], strict=False)]
    assert [list(window.series) for window in windows] == [["probe"], ["probe", "elbow"], ["probe"]]
    for name, series in whole.series.items():
        parts = [window[name] for window in windows if name in window.series]
        for field in ("times", "values", "noise"):
            joined = np.concatenate([getattr(part, field) for part in parts])
            np.testing.assert_array_equal(joined, getattr(series, field))
    with pytest.raises(ValueError, match=r"a window that contains samples.* 0\.0 and 0\.3 s"):
        whole.between(0.3001, 1.0)


def test_names_are_checked_against_the_scene():
    scene, _ = cj.mechanisms.double_pendulum()
    together().check(scene)
    lost = cj.Series(q.Position("arm 4", "x"), [0.0], [0.0], 1.0)
    own = cj.Series(lambda now: now.time, [0.0], [0.0], 1.0, unit="s")
    with pytest.raises(ValueError, match=r"^Series 'camera': .*\['arm 2', 'arm 3', 'gr.* 'arm 4'"):
        cj.Measurements({"own": own, "camera": lost}).check(scene)


def test_dataset_has_units_and_comes_back():
    whole = together()
    dataset = whole.to_dataset()
    assert dataset["probe"].dims == ("probe_time",)
    assert dataset["probe"].attrs == {"units": "m", "ancillary_variables": "probe_noise"}
    assert dataset["elbow_time"].attrs == {"units": "s"}
    channels = {
        name: cj.Channel(series.channel, noise=dataset[f"{name}_noise"].values)
        for name, series in whole.series.items()
    }
    back = cj.from_xarray(dataset, channels)
    for name, series in whole.series.items():
        assert back[name].unit == series.unit
        for field in ("times", "values", "noise"):
            np.testing.assert_array_equal(getattr(back[name], field), getattr(series, field))


def test_dataset_shares_the_time_where_the_series_do():
    dataset = cj.Measurements({"a": probe(), "b": probe()}).to_dataset()
    assert dataset["a"].dims == dataset["b_noise"].dims == ("time",)
    with pytest.raises(ValueError, match='rename those called "time"'):
        cj.Measurements({"time": probe()}).to_dataset()
    with pytest.raises(ValueError, match="whose names differ from"):
        cj.Measurements({"a": probe(), "a_noise": probe()}).to_dataset()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"times": [0.0, 0.2, 0.1]}, r"`times\[2\]` must be later than the time before, .* 0\.1: "),
        ({"times": [0.0, 0.1, 0.1]}, r"`times\[2\]` must be later.*repeated"),
        ({"times": [0.0, math.nan, 0.1]}, r"`times\[1\]` must be finite, but is nan"),
        ({"times": []}, r"`times` must be a row of times, but is \(0,\)"),
        ({"values": [0.0, 1.0]}, r"`values` must be of the shape \(3,\) of the times"),
        ({"values": [0.0, math.inf, 1.0]}, r"`values\[1\]` must be finite, but is inf"),
        ({"noise": [1.0, 2.0]}, r"`noise` must be of the shape \(3,\) of the times, .* is \(2,\)"),
        ({"noise": 0.0}, r"`noise\[0\]` must be finite and positive, but is 0\.0"),
        ({"noise": [1.0, 1.0, -1.0]}, r"`noise\[2\]` must be finite and positive"),
        ({"unit": "kg"}, "`unit` must be a unit of 'm', but is 'kg'"),
        ({"values": [0.0, math.nan, 1.0], "name": "gap"}, r"`values of 'gap'\[1\]` must be finite"),
    ],
)
def test_invalid_series_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        probe(**changes)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: cj.Series(lambda now: now.time, [0.0], [1.0], 1.0), "`unit` must be given for a"),
        (lambda: cj.Series("probe", [0.0], [1.0], 1.0), "`channel` must be a scalar .*'probe'"),
        (lambda: cj.Measurements({}), "`series` must be a dictionary with at least one"),
        (lambda: cj.Measurements({"a": [1.0]}), r"`series\['a'\]` must be a Series, but is 'list'"),
        (lambda: probe().residuals(np.zeros(2)), r"`prediction` must be of shape \(3,\)"),
    ],
)
def test_what_is_no_series_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
