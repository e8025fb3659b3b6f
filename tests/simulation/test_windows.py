"""Time windows of reductions, and quantiles: over steps of a synthetic run, and in real runs."""

from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from tests.support.oscillator import on_spring
from tests.support.programs import primitives

W = 7.0
ENDS = np.cumsum([0.0, *np.random.default_rng(3).uniform(0.005, 0.02, 160)])
"""Ends of the synthetic steps, s, up to about 2 s; each at least 0.8 periods long."""
WINDOWS = [(None, None), (0.3013, 0.8021), (0.40001, 0.40302)]


@dataclass
class Depth:
    """Depth, m, and rate, m/s, of a synthetic contact."""

    depth: jax.Array
    rate: jax.Array


@partial(jax.tree_util.register_dataclass, data_fields=["time"], meta_fields=["before"])
@dataclass
class Fake:
    """An instant of a synthetic run: everything in it is a function of time."""

    time: jax.Array
    before: float = 0.0
    bristle_energy = memory = None

    def inside(self, place):
        return Fake(self.before + place * (self.time - self.before))

    @property
    def middle(self):
        return self.inside(0.5)

    def before_and_after(self, value_of):
        value = value_of(self)
        return value, value

    @property
    def work(self):
        return {"friction": self.time**2, "film": jnp.sin(self.time)}

    @property
    def contact_gaps(self):
        return {"pin": {"V": Depth(wave(self), W * jnp.cos(W * self.time))}}


def wave(now):
    return jnp.sin(W * now.time)


def reduced(reductions: dict) -> dict:
    """Results of the reductions for the synthetic run, by their keys; one program for all."""

    def step(tallies, span):
        now = Fake(span[1], span[0])
        return {key: one.update(tallies[key], now) for key, one in reductions.items()}, None

    @jax.jit
    def run(spans):
        first, last = Fake(spans[0, 0]), Fake(spans[-1, 1])
        tallies = {key: one.start(first) for key, one in reductions.items()}
        tallies, _ = jax.lax.scan(step, tallies, spans)
        return {key: one.results(tallies[key], last) for key, one in reductions.items()}

    found = run(np.stack([ENDS[:-1], ENDS[1:]], axis=1))
    for key, reduction in reductions.items():
        assert set(found[key]) == set(reduction.units())
    return jax.tree.map(float, found)


LEVELS = (0.05, 0.5, 0.95)
MADE = {
    "peak": partial(cj.Peak, wave, "m"),
    "statistics": partial(cj.Statistics, wave, "m"),
    "count": partial(cj.ImpactCount, "pin"),
    "lost": cj.DissipatedEnergy,
    "quantiles": partial(cj.Quantiles, wave, "m", np.linspace(-1, 1, 81), LEVELS),
}


@pytest.fixture(scope="module")
def found():
    """Each reduction in each window, and quantiles without edges."""
    beyond = cj.Quantiles(wave, "m", [-0.5, 0.0, 0.5], LEVELS)
    keys = {
        f"{kind} {(after, until)}": make(after=after, until=until)
        for kind, make in MADE.items()
        for after, until in WINDOWS
    }
    return reduced({**keys, "beyond": beyond})


@pytest.mark.parametrize("window", WINDOWS)
def test_reductions_are_those_of_the_window(found, window):
    after = 0.0 if window[0] is None else window[0]
    until = ENDS[-1] if window[1] is None else window[1]
    times = np.linspace(after, until, 100_001)
    values = np.sin(W * times)
    peak = found[f"peak {window}"]
    assert peak[""] == pytest.approx(values.max(), abs=1e-7)
    assert np.sin(W * peak["time"]) == pytest.approx(peak[""], abs=1e-6)
    assert after - 1e-12 <= peak["time"] <= until + 1e-12
    statistics = found[f"statistics {window}"]
    mean = (np.cos(W * after) - np.cos(W * until)) / W / (until - after)
    expected = {"mean": mean, "smallest": values.min(), "largest": values.max()}
    for name, value in expected.items():
        assert statistics[name] == pytest.approx(value, abs=3e-5), name
    onsets = 2.0 * np.pi / W * np.arange(20)
    assert found[f"count {window}"][""] == ((onsets >= after) & (onsets < until)).sum()
    lost = until**2 + np.sin(until) - after**2 - np.sin(after)
    assert found[f"lost {window}"][""] == pytest.approx(lost, rel=1e-12)
    for level in LEVELS:
        quantile = np.quantile(values, level)
        assert found[f"quantiles {window}"][f"{level:g}"] == pytest.approx(quantile, abs=0.025)


@pytest.mark.parametrize(("first", "last", "number"), [(-1e-3, 1e-3, 1), (1e-3, 0.1, 0)])
def test_an_onset_is_timed_within_its_step(first, last, number):
    """Steps of 5 ms and more pass the onset."""
    onset = 2.0 * np.pi / W
    count = cj.ImpactCount("pin", after=onset + first, until=onset + last)
    spans = zip(ENDS[:-1], ENDS[1:], strict=True)
    begin, end = next(span for span in spans if span[1] > onset)
    assert end - onset > 2e-3
    tally = count.update(count.start(Fake(jnp.asarray(begin))), Fake(jnp.asarray(end), begin))
    assert float(count.results(tally, Fake(jnp.asarray(2.0)))[""]) == number


@pytest.mark.parametrize(
    ("reduction", "at_start", "at_end", "expected"),
    [
        # Of a ledger that grows by 12 J, and of the integrals of t and t^2, from 1 s to 3 s.
        (cj.DissipatedEnergy(), [5.0], [17.0], {"": 12.0}),
        (cj.MeanPowerLost(), [5.0], [17.0], {"": 6.0}),
        (cj.Integral(wave, "m s"), [0.5], [4.5], {"": 4.0}),
        (
            cj.Statistics(wave, "m"),
            [0.5, 1.0 / 3.0],
            [4.5, 9.0],
            {"mean": 2.0, "rms": np.sqrt(13.0 / 3.0)},
        ),
    ],
)
def test_results_of_a_window_follow_from_integrals_at_its_edges(
    reduction, at_start, at_end, expected
):
    found = reduction.combined(jnp.asarray([at_start, at_end]), (1.0, 3.0))
    assert jax.tree.map(float, found) == pytest.approx(expected, rel=1e-12)


def test_quantiles_beyond_the_edges_are_nan(found):
    beyond = found["beyond"]
    assert np.isnan(beyond["0.05"]) and np.isnan(beyond["0.95"]) and abs(beyond["0.5"]) < 0.5


def test_a_window_that_no_run_reaches_has_no_results():
    first, last = Fake(jnp.asarray(0.0)), Fake(jnp.asarray(2.0))
    for make in MADE.values():
        reduction = make(after=50.0)
        results = reduction.results(reduction.start(first), last)
        assert np.isnan([float(value) for value in results.values()]).all(), reduction


@pytest.mark.parametrize(("made", "divisor"), [(cj.DissipatedEnergy, 1.0), (cj.MeanPowerLost, 2.0)])
def test_losses_of_an_earlier_run_do_not_count(made, divisor):
    """From 1 s to 3 s the ledger of `Fake` grows by t^2 + sin t."""
    first, last = Fake(jnp.asarray(1.0)), Fake(jnp.asarray(3.0))
    lost = 8.0 + np.sin(3.0) - np.sin(1.0)
    for reduction in (made(), made(until=5.0)):
        tally = reduction.update(reduction.start(first), Fake(jnp.asarray(3.0), 1.0))
        found = float(reduction.results(tally, last)[""])
        assert found == pytest.approx(lost / divisor, rel=1e-12)


def test_without_a_window_the_program_has_none():
    def operations(reduction):
        tally = reduction.start(Fake(jnp.asarray(0.0)))
        step = jax.make_jaxpr(lambda tally, t: reduction.update(tally, Fake(t, 0.0)))
        return primitives(step(tally, 0.1).jaxpr)

    for whole in (cj.Peak(wave, "m"), cj.ImpactCount("pin"), cj.DissipatedEnergy()):
        fewer, more = operations(whole), operations(replace(whole, until=0.5))
        assert not fewer - more and more.total() > fewer.total()
    assert operations(cj.DissipatedEnergy()).total() == 0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: cj.Peak(wave, "m", after=2.0, until=1.0), "`until`.*later than after = 2.0"),
        (lambda: cj.DissipatedEnergy(after=1.0, until=1.0), "`until`.*later"),
        (lambda: cj.ImpactCount("pin", after=float("nan")), "`after`.*time in s"),
        (lambda: cj.ImpactTable(5, after=3.0, until=2.0), "`until`.*later than after = 3.0"),
        (lambda: cj.ArchardWear("pin", 1e-5, 2e9, until=(1, 2)), "`until`.*time"),
        (lambda: cj.Quantiles(wave, "m", [1.0, 1.0]), "`edges`.*rising"),
        (lambda: cj.Quantiles(wave, "m", [1.0]), "`edges`.*rising"),
        (lambda: cj.Quantiles(wave, "m", [1.0, 2.0], 95), "`levels`.*0.95 for 95 %"),
        (lambda: cj.Quantiles(wave, "m", [1.0, 2.0], (0.5, 0.5000001)), "`levels`.*six digits"),
        (lambda: cj.Quantiles(wave, "m", [1.0, 2.0], [[0.5]]), "`levels`.*a row of numbers"),
        (lambda: cj.Quantiles(wave, "m", [1.0, 2.0], (0.5, 1.0)), "`levels`.*below 1"),
        (lambda: cj.Quantiles(wave, "m", "all"), "`edges` must be a number.*'all'"),
        (lambda: cj.Peak(wave, "m", until="1 s"), "`until` must be a number.*'1 s'"),
        (lambda: cj.Section(wave, {"x": (wave, "m")}, after="1 s"), "`after` must be a number"),
        (lambda: cj.RejectedSteps(after=[1.0, 2.0]), "`after` must be .*pass one time in s"),
        (lambda: cj.ArchardWear("pin", 1e-5, "2 GPa"), "`hardness` must be a number.*'2 GPa'"),
        (lambda: cj.Peak(wave, 3), "`unit` must be text, but is 3"),
    ],
)
def test_invalid_windows_and_edges_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def quarters(number):
    """End of the quarter period with a number, s, of a mass of 2 kg on a spring."""
    return lambda scene: 0.5 * jnp.pi * number * jnp.sqrt(2.0 / scene.forces["spring"].stiffness)


@pytest.mark.slow
def test_a_window_may_follow_the_values_of_a_lane():
    """x = 0.3 cos(w t): its mean over the second quarter period is -0.6/pi, whatever the
    stiffness."""
    stiffness = [20.0, 50.0, 80.0]
    scene, state = on_spring("mass", 50.0, 2.0, 0.3)
    x = cj.quantities.Position("mass", "x")
    window = {"after": quarters(1), "until": quarters(2)}
    outputs = {"x": cj.Statistics(x, "m", **window), "top": cj.Peak(x, "m", after=quarters(3))}
    axes = {"k": cj.Axis(lambda s: s.forces["spring"].stiffness, stiffness)}
    settings = cj.Settings(rtol=1e-10)
    found = cj.sweep(scene, state, 1.6, axes, outputs=outputs, settings=settings, progress=False)
    np.testing.assert_allclose(found.x_mean, -0.6 / np.pi, rtol=1e-5)
    # The stiffest mass is back at its start at 4 quarters; the softest does not get there.
    rate = np.sqrt(np.array(stiffness) / 2.0)
    expected = np.where(2.0 * np.pi / rate < 1.6, 0.3, 0.3 * np.cos(1.6 * rate))
    np.testing.assert_allclose(found.top, expected, rtol=1e-6)
    alone = cj.simulate(scene, state, 1.6, settings, outputs=outputs)
    np.testing.assert_array_equal(alone.outputs["x_mean"], found.x_mean[1])


@pytest.mark.parametrize("edge", [lambda scene: jnp.ones(2), lambda scene: "1 s"])
@pytest.mark.parametrize("output", [partial(cj.Peak, wave, "m"), partial(cj.ImpactTable, 5)])
def test_windows_of_the_scene_are_single_times(output, edge):
    outputs = {"a": output(until=edge)}
    with pytest.raises(ValueError, match="`until` must be .* one real number.*return one time"):
        cj.simulate(*cj.mechanisms.double_pendulum(), 1e-3, outputs=outputs, progress=False)


@pytest.mark.parametrize(("after", "until"), [(2.001, 3.0), (None, 2.0), (0.0, 1.0)])
def test_results_of_windows_that_a_run_does_not_cover_are_nan(after, until):
    window = {"after": after, "until": until}
    outputs = {
        "impacts": cj.ImpactCount("shoulder", **window),
        "energy": cj.DissipatedEnergy(**window),
        "power": cj.MeanPowerLost(**window),
        "wear": cj.ArchardWear("shoulder", 1e-4, 2e9, sectors=2, **window),
        "peak": cj.Peak(cj.quantities.ContactForce("shoulder"), "N", **window),
        "sum": cj.Integral(cj.quantities.ContactForce("shoulder"), "N s", **window),
    }
    scene, state = cj.mechanisms.double_pendulum()
    options = {"outputs": outputs, "start_time": 2.0, "progress": False}
    solution = cj.simulate(scene, state, 2.001, cj.Settings(ledger=True), **options)
    assert len(solution.outputs) == 13
    assert all(np.isnan(value) for value in solution.outputs.values())
