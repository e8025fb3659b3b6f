"""Structural zeros and ones of a scene, and their effect on programs and results."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from clearjoint._math.vectors import fold_constants
from clearjoint.extend import EulerParameters, Matrix, Vector, pack, unpack


def test_exact_zeros_and_ones_of_vectors_are_structural():
    tree = {"axis": np.array([0.0, 1.0, 1e-300]), "number": np.zeros(()), "other": np.zeros(5)}
    folded_scene = fold_constants(tree)
    assert folded_scene.patterns == ((0.0, 1.0, None), None, None)
    axis = unpack(folded_scene)["axis"]
    assert isinstance(axis, Vector) and type(axis.x) is type(axis.y) is float
    assert axis.z == 1e-300 and type(axis.z) is not float
    np.testing.assert_array_equal(pack(axis), tree["axis"])


def test_components_of_matrices_keep_their_order():
    matrix = np.array([[2.0, 0.0, 3.0], [0.0, 1.0, 0.0], [4.0, 0.0, 5.0]])
    found = unpack(fold_constants(matrix))
    assert isinstance(found, Matrix)
    assert (found.row_x.y, found.row_y.y, found.row_z.y) == (0.0, 1.0, 0.0)
    np.testing.assert_array_equal(pack(found), matrix)


class Tables(eqx.Module):
    table: Any = eqx.field(metadata={"table": True})
    point: Any


@pytest.mark.parametrize("shape", [(3,), (4,), (3, 3)])
def test_fields_declared_as_tables_stay_arrays(shape):
    ones = np.ones(shape)
    tree = {"inner": [Tables((ones, ones), ones), Tables(ones, Tables(ones, ones))]}
    for folded_scene in (tree, fold_constants(tree)):
        first, second = unpack(folded_scene)["inner"]
        for table in (*first.table, second.table, second.point.table):
            assert table is ones
        for point in (first.point, second.point.point):
            assert isinstance(point, Vector | EulerParameters | Matrix)
    patterns = fold_constants(tree).patterns
    assert [patterns[k] for k in (0, 1, 3, 4)] == [None] * 4


def test_varied_and_traced_numbers_are_not_structural():
    assert fold_constants(np.zeros(3), varied=True).patterns == ((None, None, None),)
    patterns = []

    def trace(x):
        patterns.extend(fold_constants(x).patterns)
        return x

    jax.jit(trace)(jnp.zeros(3))
    assert patterns == [(None, None, None)]


def test_scenes_share_a_program_for_other_numbers_but_not_for_other_zeros():
    def folded_scene(gravity):
        return jax.tree.structure(fold_constants({"gravity": np.array(gravity)}))

    assert folded_scene([0.0, 9.81, 0.0]) == folded_scene([0.0, 1.62, 0.0])
    assert folded_scene([0.0, 9.81, 0.0]) != folded_scene([0.1, 9.81, 0.0])
    assert folded_scene([0.0, 9.81, 0.0]) != folded_scene([0.0, 1.0, 0.0])
