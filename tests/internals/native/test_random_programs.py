"""Random programs in native code against XLA: branches, loops, views and repeated arrays."""

from collections import Counter

import jax
import numpy as np
import pytest
from jax.extend.core import jaxpr_as_fun

from clearjoint._native import UnsupportedPrimitiveError
from clearjoint._native.functions import NativeProgram
from tests.support.random_programs import RandomProgram

OPTIONS: dict[str, str | bool] = {
    "xla_backend_optimization_level": "0",
    "xla_disable_hlo_passes": "fusion",
    # Later versions do not know this option.
    **({"xla_cpu_use_fusion_emitters": False} if jax.__version_info__ < (0, 12) else {}),
}
"""Fused, XLA writes parts of an array over others before it reads them: of 0, 1, 2, ..., whose
first 39 numbers replace those from the fifth on, it makes 0 to 4 repeated. For a few programs its
fusion ends the process."""


def agrees(found: list[np.ndarray], expected: list[jax.Array]) -> bool:
    return all(
        one.dtype == other.dtype and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
        for one, other in zip(found, map(np.asarray, expected), strict=True)
    )


@pytest.mark.parametrize(
    ("seeds", "size"),
    [(range(30), 4), pytest.param(range(1000, 3000), 14, marks=pytest.mark.slow)],
    ids=["few", "many"],
)
def test_random_programs_give_what_xla_gives(seeds, size):
    """All numbers are exact. Every fourth program has vectors of tangents."""
    ends, wrong = Counter(), []
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
            found = native(arguments)
            # Without fusion too, XLA overwrites views in rare loops, unlike operation by operation.
            same = agrees(found, xla(*arguments)) or agrees(found, jaxpr_as_fun(closed)(*arguments))
            if not same:
                wrong.append((seed, number))
    assert not wrong, wrong
    assert ends["supported"] > 10 * ends["unsupported"], ends
