"""Checks of numbers: those of traced numbers, which are refused like known ones, and those that
warn."""

import warnings
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._fields.cautions import quiet
from clearjoint._fields.checks import conditions_of, recheck
from clearjoint._simulation.run.run_checks import check_numbers
from clearjoint._sweeps.axes import lanes_of
from tests.internals.scene_files.test_round_trips import ELEMENTS, example
from tests.scene_files.test_round_trips import BODIES, STATE

VALUES = (np.nan, np.inf, -np.inf, -1.0, 0.0, 0.5, 1e6)
"""Values that replace each number of each element."""


def variants(tree: Any) -> tuple[list[Any], list[tuple[str, float]]]:
    """Yield the tree with one number replaced by one of the values, and a name of the variant."""
    leaves, structure = jax.tree.flatten(tree)
    trees, labels = [], []
    for k, (path, leaf) in enumerate(jax.tree_util.tree_leaves_with_path(tree)):
        for value in VALUES:
            changed = np.array(leaf, dtype=float)
            changed.flat[0] = value
            trees.append(jax.tree.unflatten(structure, [*leaves[:k], changed, *leaves[k + 1 :]]))
            labels.append((jax.tree_util.keystr(path), value))
    return trees, labels


def is_refused(tree: Any) -> bool:
    try:
        check(tree)
    except ValueError:
        return True
    return False


def check(tree: Any) -> None:
    if isinstance(tree, tuple):
        return check_numbers(*tree)
    return recheck(tree)


@pytest.fixture(scope="module")
def everything() -> dict[str, tuple[list[Any], list[tuple[str, float]]]]:
    """Variants of each exported element, and of a scene with its state, by name."""
    with quiet():
        subjects = {name: example(name) for name in ELEMENTS}
        subjects["Scene and State"] = cj.Scene(BODIES, gravity=(0.0, -9.81, 1.0)), STATE
    return {name: variants(one) for name, one in subjects.items() if jax.tree.leaves(one)}


@pytest.fixture(scope="module")
def admissible(everything) -> dict[str, np.ndarray]:
    """Return for each variant whether the conditions on traced numbers hold."""
    stacked = {
        name: jax.tree.map(lambda *leaves: np.stack([np.asarray(x, float) for x in leaves]), *trees)
        for name, (trees, _) in everything.items()
    }

    def holds(tree: Any) -> list[jax.Array]:
        return conditions_of(lambda: check(tree))

    found = jax.jit(lambda trees: {name: jax.vmap(holds)(one) for name, one in trees.items()})
    return {name: np.all(held, axis=0) for name, held in found(stacked).items()}


@pytest.mark.parametrize("name", [*ELEMENTS, "Scene and State"])
def test_traced_numbers_are_refused_like_known_ones(name, everything, admissible):
    if name not in everything:
        pytest.skip("has no numbers")
    trees, labels = everything[name]
    refused = [is_refused(tree) for tree in trees]
    assert [*zip(labels, ~admissible[name], strict=True)] == [*zip(labels, refused, strict=True)]
    accepted = [label for label, no in zip(labels, refused, strict=True) if not no]
    assert all(np.isfinite(value) for _, value in accepted)


class Blade(cj.extend.AbstractFriction):
    """A friction whose check needs known numbers."""

    coefficient: float

    def __check_init__(self):
        if self.coefficient < 0.0:
            raise ValueError("negative")

    def ratio(self, slip_speed):
        return self.coefficient * jnp.tanh(slip_speed / 1e-3)


def test_checks_that_need_known_numbers_are_left_out():
    found = jax.eval_shape(lambda blade: conditions_of(lambda: recheck(blade)), Blade(0.1))
    assert found == []


def test_repeated_checks_and_traced_numbers_give_no_warning():
    """Neither the checks of a run, nor lanes of a sweep, nor traced numbers."""
    with pytest.warns(cj.UnusualValueWarning):
        soft = cj.laws.RavnStiffness(207, 0.3)
    scene, state = cj.mechanisms.double_pendulum(law=cj.laws.Hertz(soft))
    change = cj.Axis.change(lambda scene, state, m: (_with_mass(scene, m), state), [7e3, 8e3])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        recheck(scene)
        lanes = lanes_of(scene, state, {"mass": change}, {"mass": np.array([7e3, 8e3])})
        jax.jit(lambda modulus: cj.laws.RavnStiffness(modulus, 0.3).young_modulus)(207.0)
        jax.vmap(lambda mass: cj.Body(mass, (1.0, 1.0, 1.0)).mass)(np.array([1e9, 1e10]))
    assert not lanes.bad


def _with_mass(scene, mass):
    arm = cj.Body(mass, (0.0010, 0.5855, 0.5855))
    return cj.Scene({**scene.bodies, "arm 2": arm}, scene.joints, gravity=scene.gravity)
