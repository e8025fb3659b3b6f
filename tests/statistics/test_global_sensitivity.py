"""Sobol indices of the Ishigami function, whose closed form is known."""

import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj

A, B = 7.0, 0.1


class Ishigami(cj.extend.AbstractReduction):
    """The Ishigami function of the gravity of the scene."""

    def start(self, now):
        return jnp.zeros(())

    def update(self, tally, now):
        return tally

    def results(self, tally, now):
        g = now.scene.gravity
        return {"": jnp.sin(g.x) + A * jnp.sin(g.y) ** 2 + B * g.z**4 * jnp.sin(g.x)}

    def units(self):
        return {"": "1"}


def closed_form():
    """First and total indices by the three arguments."""
    pi = np.pi
    alone = [0.5 * (1.0 + B * pi**4 / 5.0) ** 2, A**2 / 8.0, 0.0]
    both = B**2 * pi**8 * (1.0 / 18.0 - 1.0 / 50.0)  # of the first and the third argument
    total = [alone[0] + both, alone[1], both]
    return np.array(alone) / (sum(alone) + both), np.array(total) / (sum(alone) + both)


def indices(**options):
    # No number of the scene is 0 or 1, which would be folded as a constant.
    scene = cj.Scene({"ball": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}, gravity=(0.3, 0.2, 0.1))
    state = cj.State({"ball": cj.body_state((0.0, 0.0, 0.0))})
    uncertain = {
        name: cj.Uncertain(lambda scene, k=k: scene.gravity[k], between=(-np.pi, np.pi))
        for k, name in enumerate("xyz")
    }
    return cj.sobol_indices(
        scene, state, 1e-3, uncertain, {"f": Ishigami()}, progress=False, **options
    )


def test_indices_of_the_ishigami_function():
    found = indices(count=1024)
    for order, exact in zip(("first_order", "total_order"), closed_form(), strict=True):
        np.testing.assert_allclose(found[f"f_{order}"].values, exact, atol=0.02)
        low, high = found[f"f_{order}_low"].values, found[f"f_{order}_high"].values
        assert ((low <= exact + 1e-12) & (exact <= high)).all()
    assert float(found["f_mean"]) == pytest.approx(A / 2.0, abs=0.05)
    assert int(found["failed"]) == 0


def test_seeds_give_the_same_bits():
    first, second = indices(count=64, seed=4), indices(count=64, seed=4)
    assert first.equals(second)
    assert not first.equals(indices(count=64, seed=5))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"count": 100}, "`count` must be a power of two, but is 100"),
        ({"confidence": 2.0}, "`confidence` must be between 0 and 1"),
    ],
)
def test_bad_arguments_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        indices(**options)


def test_groups_with_a_failed_run_are_left_out():
    from clearjoint.statistics.global_sensitivity import _indices

    groups = np.random.default_rng(0).standard_normal((32, 4))
    groups[3, 2] = np.nan
    with pytest.warns(UserWarning, match="16 of 32 groups") as caught:
        found = _indices(groups, 0.95, 0)
    assert caught[0].filename == __file__
    assert found["first_order"].shape == (2,)
