"""Numbers as they are shown, and what is a number."""

from unittest.mock import ANY

import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint import extend
from clearjoint._fields.checks import as_number, as_shown


def test_rounding_errors_are_not_printed():
    """After a logarithm and its inverse, in an error, an element and a list."""
    rounded = float(np.exp(np.log(5e-6)))
    assert rounded != 5e-6
    with pytest.raises(ValueError, match=r"but is 5e-06: give it in m\."):
        extend.require(False, "clearance", rounded, "larger", "give it in m")
    hertz = repr(cj.laws.Hertz(rounded * 1e12))
    assert hertz == "Hertz(stiffness=GivenStiffness(stiffness=5000000.0))"
    assert as_shown([rounded, 1 / 3, -0.0, np.nan, "a", 3]) == [5e-6, 1 / 3, 0.0, ANY, "a", 3]
    assert as_shown(np.array([2.0, 0.5], np.longdouble)) == [2.0, as_shown(np.longdouble(0.5))]


@pytest.mark.parametrize(
    "value",
    [
        np.array([1.0 + 2.0j]),
        jnp.array([1.0 + 2.0j]),
        jnp.array(True),
        np.array(["2026-01-01"], "M8[D]"),
        True,
        [None, 1.0],
    ],
)
def test_only_real_numbers_are_numbers(value):
    with pytest.raises(ValueError, match="`mass` must be a number or an array of numbers"):
        as_number(value, "mass", "kg")
