"""Declarations of fields are checked at construction and by `recheck`."""

from typing import Any

import jax
import pytest

import clearjoint as cj
from clearjoint._fields.checks import recheck
from clearjoint._fields.objects import AbstractConverting
from clearjoint.extend import optional_quantity, quantity, require_axis


class Part(AbstractConverting):
    mass: Any = quantity("kg", positive=True)
    play: Any = quantity("m", positive=True, zero=True, default=0.0, remedy="measure it")
    share: Any = quantity("1", within=(0.0, 1.0), default=0.5)
    force: Any = quantity("N", shape=(3,), default=(0.0, 0.0, 1.0))
    angle: Any = quantity("rad", shape=(), default=0.0)
    axis: Any = quantity("1", check=require_axis, default=(0.0, 0.0, 1.0))
    length: Any = optional_quantity("m", positive=True, usual=(1e-3, 10.0))


WRONG = {
    "a sign": ({"mass": -1}, "`mass` must be positive, but is -1.0: give it in kg"),
    "a sign, zero allowed": ({"play": -1}, "`play` must be zero or positive, .*: measure it"),
    "a range": ({"share": 1.5}, r"`share` must be in \[0.0, 1.0\], but is 1.5"),
    "a shape": ({"force": (1, 2)}, r"`force` must be an array of shape \(3,\).*components in N"),
    "several": ({"angle": (1, 2)}, r"`angle` must be an array of shape \(\).*number in rad"),
    "no number": ({"force": (0, 0, float("nan"))}, "`force` must be finite"),
    "a check": ({"axis": (0, 0, 0)}, "`axis` must be a vector of non-zero length"),
    "an absent one": ({"length": 0}, "`length` must be positive, but is 0.0: give it in m"),
}


@pytest.mark.parametrize("case", WRONG)
def test_declarations_are_checked(case):
    values, message = WRONG[case]
    with pytest.raises(ValueError, match=message):
        Part(**({"mass": 1.0} | values))


def test_unusual_numbers_give_a_warning():
    with pytest.warns(
        cj.UnusualValueWarning, match="`length` is 20 m, where at most 10 m is usual"
    ):
        Part(1.0, length=20.0)


def test_declarations_are_checked_again_but_not_for_traced_numbers():
    part = jax.tree.map(lambda leaf: -leaf, Part(1.0))
    with pytest.raises(ValueError, match="`mass` must be positive"):
        recheck(part)
    assert float(jax.jit(lambda mass: Part(mass).mass)(-1.0)) == -1.0
