"""Random programs in native code against XLA: branches, loops, views and repeated arrays."""

from collections import Counter

import jax
import numpy as np
import pytest
from jax.extend.core import jaxpr_as_fun

from clearjoint.native import UnsupportedPrimitiveError
from clearjoint.native.functions import NativeProgram
from tests.support.random_programs import RandomProgram

OPTIONS = {"xla_backend_optimization_level": "0", "xla_disable_hlo_passes": "fusion"}
"""Fused, XLA 0.10 writes parts of an array over others before it reads them: of 0, 1, 2, ..., whose
first 39 numbers replace those from the fifth on, it makes 0 to 4 repeated. For a few programs its
fusion ends the process."""


def is_same(one: np.ndarray, other: np.ndarray) -> bool:
    nan = one.dtype.kind == "f"
    return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=nan)


@pytest.mark.parametrize(
    ("seeds", "size"),
    [(range(100), 6), pytest.param(range(1000, 3000), 14, marks=pytest.mark.slow)],
    ids=["few", "many"],
)
def test_random_programs_give_what_xla_gives(seeds, size):
    """All numbers are exact. Every fourth program has vectors of tangents."""
    ends, wrong = Counter(), {}
    for seed in seeds:
        program = RandomProgram(seed, size)
        closed = jax.make_jaxpr(program)(*program.arguments(0))
        try:
            native = NativeProgram(closed, tangents=4 if seed % 4 == 3 else 0)
        except UnsupportedPrimitiveError as error:
            ends["unsupported"] += 1
            assert str(error)
            continue
        ends["supported"] += 1
        xla = jax.jit(jaxpr_as_fun(closed), compiler_options=OPTIONS)
        for number in range(2):
            arguments = program.arguments(number)
            expected, found = map(np.asarray, xla(*arguments)), native(arguments)
            same = [is_same(*pair) for pair in zip(found, expected, strict=True)]
            if not all(same):
                wrong[seed, number] = same
    assert not wrong, wrong
    assert ends["supported"] > 10 * ends["unsupported"], ends
