"""Shapes that annotations say are checked in this suite, at calls and of what comes back."""

import jaxtyping
import numpy as np
import pytest

from clearjoint import RESULTS, Starts
from clearjoint.results import Minimum
from tests.support.shapes import checking, modules_with_shapes


def test_a_wrong_shape_for_a_method_is_refused():
    starts = Starts(3)
    assert starts.around(np.zeros(2), ["a", "b"]).shape == (3, 2)
    with pytest.raises(jaxtyping.TypeCheckError, match="first"):
        starts.around(np.zeros((2, 1)), ["a", "b"])


def test_a_wrong_shape_of_a_field_is_refused():
    with pytest.raises(jaxtyping.TypeCheckError, match="coordinates"):
        Minimum({}, np.zeros((1, 1)), 0.0, np.zeros(0), RESULTS.successful)


def test_shapes_agree_with_each_other():
    def product(
        matrix: jaxtyping.Float[np.ndarray, "p p"], vector: jaxtyping.Float[np.ndarray, " p"]
    ) -> jaxtyping.Float[np.ndarray, " p"]:
        return matrix @ vector

    checked = jaxtyping.jaxtyped(typechecker=checking)(product)
    checked(np.eye(2), np.ones(2))
    with pytest.raises(jaxtyping.TypeCheckError):
        checked(np.eye(2), np.ones(3))


def test_modules_with_public_shapes_are_checked():
    named = {name.split(".")[1].removeprefix("_") for name in modules_with_shapes()}
    assert {"identification", "information", "measurements", "dynamics", "sweeps"} <= named
