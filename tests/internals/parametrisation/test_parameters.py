"""Units and values at a path, paths that lead to no number, and the number of tangents."""

from typing import Any, ClassVar

import equinox as eqx
import jax
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._compilation.xla import program_of
from clearjoint._fields.checks import recheck, recheck_changes
from clearjoint._parametrisation.parametrised_scene import parametrised
from clearjoint._parametrisation.paths import unit_at, value_at
from clearjoint.extend import quantity
from tests.parametrisation import test_parameters

scene = test_parameters.scene


def test_units_of_numbers_in_scenes_and_states(scene):
    state = cj.mechanisms.double_pendulum()[1]
    assert unit_at(scene, lambda s: s.bodies["arm 2"].mass) == "kg"
    assert unit_at(scene, lambda s: s.gravity[1]) == "m/s^2"
    assert unit_at(scene, lambda s: s.joints["shoulder"].law.restitution) == "1"
    assert unit_at(state, lambda s: s.bodies["arm 3"].spin[2]) == "rad/s"


def test_components_of_matrices():
    tree = {"matrix": np.arange(9.0).reshape(3, 3)}
    assert value_at(tree, lambda t: t["matrix"][1, 2]) == 5.0
    assert value_at(tree, lambda t: t["matrix"][1][2]) == 5.0
    assert cj.set_value(tree, lambda t: t["matrix"][0, 1], -1.0)["matrix"][0].tolist() == [0, -1, 2]


def test_an_index_beyond_a_tuple_is_refused():
    with pytest.raises(ValueError, match="`path`.*beyond the end of a tuple or list: count from 0"):
        value_at({"stiffnesses": (1.0, 2.0)}, lambda t: t["stiffnesses"][2])


@pytest.mark.parametrize("first", [slice(0, 2), ..., (0, slice(1, 3))])
def test_an_index_after_a_slice_is_refused(first):
    """It would count along the slice."""
    tree = {"matrix": np.arange(9.0).reshape(3, 3)}
    assert np.size(value_at(tree, lambda t: t["matrix"][first])) > 1
    with pytest.raises(ValueError, match="`path` must be indexed no further after a slice"):
        value_at(tree, lambda t: t["matrix"][first][1])


class LawWithClassVariables(cj.laws.Hertz):
    """A user-defined law with annotations that are not fields."""

    uses_entry_speed: ClassVar[bool] = False
    exponents: ClassVar[tuple[float, ...]] = (1.5, 2.0)
    unset: ClassVar[float]
    floor: Any = quantity("m/s", default=1e-3)


def test_class_variables_are_no_parameters(scene):
    joint = scene.joints["shoulder"]
    own = eqx.tree_at(
        lambda s: s.joints["shoulder"].law, scene, LawWithClassVariables(joint.law.stiffness)
    )
    listed = cj.parameters(own)
    assert len(listed) == len(jax.tree.leaves(own))
    assert listed["joints['shoulder'].law.floor"] == (1e-3, "m/s")
    changed = cj.set_value(own, lambda s: s.joints["shoulder"].law.floor, 2e-3)
    recheck(changed)
    recheck_difference(changed, own)
    with pytest.raises(ValueError, match="clearance"):
        recheck_difference(cj.set_value(own, lambda s: s.joints["shoulder"].clearance, -1.0), own)


def recheck_difference(tree, base):
    leaves, structure = jax.tree.flatten(tree)
    changed = zip(leaves, jax.tree.leaves(base), strict=True)
    recheck_changes(tree, structure, tuple(a is not b for a, b in changed))


@pytest.mark.parametrize("count", [1, 2, 5])
def test_the_number_of_tangents_is_told(count):
    scene, state = cj.mechanisms.double_pendulum()
    paths = (
        lambda scene: scene.joints["shoulder"].clearance,
        lambda scene: scene.joints["shoulder"].law.restitution,
        lambda scene: scene.joints["shoulder"].bearing_radius,
        lambda scene: scene.joints["shoulder"].journal_length,
        lambda scene: next(iter(scene.bodies.values())).mass,
    )
    parameters = {str(k): cj.Parameter(path) for k, path in enumerate(paths[:count])}
    family = parametrised(scene, state, parameters, np.ones(count))

    def derivatives(t):
        play = lambda scene: (scene.joints["shoulder"].clearance * t, None)  # noqa: E731
        return family.with_derivatives(play, (), ())[2]

    assert program_of(derivatives, 0.0).tangents == count
    assert program_of(lambda t: 2.0 * t, 0.0).tangents == 0
