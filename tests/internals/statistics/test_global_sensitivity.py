"""Sobol indices of the Ishigami function, G-functions and sums, whose closed form is known."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import clearjoint as cj
from clearjoint._statistics.global_sensitivity import _groups, _indices
from tests.support.at_end import AtEnd
from tests.support.one_body import one_body

A, B = 7.0, 0.1


def ishigami(x, y, z, sin=np.sin):
    return sin(x) + A * sin(y) ** 2 + B * z**4 * sin(x)


def of_gravity(now):
    g = now.scene.gravity
    return ishigami(g.x, g.y, g.z, jnp.sin)


def closed_form():
    """First and total indices by the three arguments."""
    pi = np.pi
    alone = [0.5 * (1.0 + B * pi**4 / 5.0) ** 2, A**2 / 8.0, 0.0]
    both = B**2 * pi**8 * (1.0 / 18.0 - 1.0 / 50.0)  # of the first and the third argument
    total = [alone[0] + both, alone[1], both]
    return np.array(alone) / (sum(alone) + both), np.array(total) / (sum(alone) + both)


def indices(**options):
    # No number of the scene is 0 or 1, which would be folded as a constant.
    scene, state = one_body("ball", inertia=(1e-3, 1e-3, 1e-3), gravity=(0.3, 0.2, 0.1))
    uncertain = {
        name: cj.Uncertain(lambda scene, k=k: scene.gravity[k], between=(-np.pi, np.pi))
        for k, name in enumerate("xyz")
    }
    outputs = {"f": AtEnd(of_gravity)}
    return cj.sobol_indices(scene, state, 1e-3, uncertain, outputs, progress=False, **options)


def test_indices_of_the_ishigami_function():
    found = indices(draws=1024)
    for order, exact in zip(("first_order", "total_order"), closed_form(), strict=True):
        np.testing.assert_allclose(found[f"f_{order}"].values, exact, atol=0.05)
        low, high = found[f"f_{order}_low"].values, found[f"f_{order}_high"].values
        assert ((low <= exact + 1e-12) & (exact <= high)).all()
    assert float(found["f_mean"]) == pytest.approx(A / 2.0, abs=0.05)
    assert int(found["failed"]) == 0


def test_seeds_give_the_same_bits():
    first, second = indices(draws=64, seed=4), indices(draws=64, seed=4)
    assert first.equals(second)
    assert not first.equals(indices(draws=64, seed=5))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"draws": 100}, "`draws` must be a power of two, but is 100"),
        ({"confidence": 2.0}, "`confidence` must be between 0 and 1"),
    ],
)
def test_bad_arguments_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        indices(**options)


def test_groups_with_a_failed_run_are_left_out():
    groups = np.random.default_rng(0).standard_normal((32, 4))
    groups[3, 2] = np.nan
    with pytest.warns(UserWarning, match="31 of 32 groups") as caught:
        found = _indices(groups, 0.95)
    assert caught[0].filename == __file__
    assert found["first_order"].shape == (2,)
    groups[np.arange(32) % 4 != 3] = np.nan
    with pytest.raises(ValueError, match="`draws` must be 2 groups .* different randomisations"):
        _indices(groups, 0.95)


def test_the_estimator_is_that_of_scipy():
    groups = 5.0 + np.random.default_rng(0).standard_normal((64, 5))
    found = _indices(groups, 0.95)
    a, b, ab = groups[:, :1].T, groups[:, 1:2].T, groups[:, 2:].T[:, None]
    exact = stats.sobol_indices(func={"f_A": a, "f_B": b, "f_AB": ab}, n=64)
    for order in ("first_order", "total_order"):
        np.testing.assert_allclose(found[order], getattr(exact, order), rtol=1e-12)
    same = _indices(np.full((8, 4), 3.0), 0.95)
    assert not any(numbers.any() for numbers in same.values())


def test_larger_counts_append_to_the_groups_of_smaller_ones():
    first, second = _groups(3, 8, 1), _groups(3, 64, 1)
    np.testing.assert_array_equal(first, second[: len(first)])
    np.testing.assert_allclose(second.reshape(64, 5, 3)[:, :2].mean(axis=(0, 1)), 0.5, atol=0.02)


def g_function(weights):
    """Sobol's G-function and its indices."""
    weights = np.array(weights)
    parts = 1.0 / 3.0 / (1.0 + weights) ** 2
    whole = np.prod(1.0 + parts) - 1.0
    total = parts * np.prod(1.0 + parts) / (1.0 + parts)
    return (
        lambda x: np.prod((np.abs(4.0 * x - 2.0) + weights) / (1.0 + weights), axis=1),
        (parts / whole, total / whole),
    )


def weighted_sum(weights):
    weights = np.array(weights)
    return lambda x: x @ weights, (weights**2 / (weights @ weights),) * 2


FUNCTIONS = {
    "Ishigami": (lambda x: ishigami(*np.pi * (2.0 * x.T - 1.0)), closed_form()),
    "G, 3 parameters": g_function([0.0, 1.0, 4.5]),
    "G, 6 parameters": g_function([0.0, 0.5, 3.0, 9.0, 99.0, 99.0]),
    "sum of 2": weighted_sum([1.0, 2.0]),
}


def coverage(name, count, cases):
    """Share of 95 % intervals that contain the index, root mean square error of the indices and
    mean half width of their intervals."""
    function, exact = FUNCTIONS[name]
    p, inside, errors, halves = len(exact[0]), [], [], []
    for seed in range(cases):
        found = _indices(function(_groups(p, count, seed)).reshape(count, p + 2), 0.95)
        for order, truth in zip(("first_order", "total_order"), exact, strict=True):
            halves.append(found[f"{order}_high"] - found[order])
            errors.append(found[order] - truth)
            inside.append(np.abs(errors[-1]) <= halves[-1])
    return float(np.mean(inside)), float(np.sqrt(np.mean(np.square(errors)))), np.mean(halves)


FEW = [("Ishigami", 1024, 25), ("sum of 2", 256, 25)]
MANY = [(name, count, 100) for name in FUNCTIONS for count in (16, 64, 256, 1024)]


@pytest.mark.parametrize(
    ("name", "count", "cases"),
    [*FEW, *(pytest.param(*case, marks=pytest.mark.slow) for case in MANY)],
)
def test_intervals_are_as_wide_as_the_errors(name, count, cases):
    """Formerly 7 and 39 times the root mean square error; Student's quantile is 3.2. With `-s`,
    rows of the table in `studies/statistics`: groups, % of intervals that hold it, both errors."""
    share, error, half = coverage(name, count, cases)
    print(f"\n| {name} | {count} | {100.0 * share:.1f} | {error:.2g} | {half:.2g} |")
    assert share > 0.9 and half < 4.0 * error
