"""Arithmetic in the program of a sweep: what is traced, and what the compiler makes of it.

XLA computes a value anew in each fusion that wants it; the ratio of the two counts tells how often.
Counted are operations that make a float of floats; not counted are comparisons and selections.
"""

import re
from collections import Counter
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from clearjoint.lanes import WINDOW, Orders, turn
from clearjoint.pool import Common, Seat, advance
from clearjoint.sweeps.task import Work, extent
from studies.benchmarks.observed import begun, one_device

JAXPR = {
    *("add", "sub", "mul", "div", "neg", "abs", "sign", "max", "min", "rem", "floor"),
    *("pow", "integer_pow", "square", "sqrt", "rsqrt", "cbrt", "exp", "expm1", "log", "log1p"),
    *("sin", "cos", "tan", "atan2", "tanh", "logistic", "erf"),
}
HLO = {
    *("add", "subtract", "multiply", "divide", "negate", "abs", "sign", "maximum", "minimum"),
    *("remainder", "floor", "power", "sqrt", "rsqrt", "cbrt", "exponential"),
    *("exponential-minus-one", "log", "log-plus-one"),
    *("sine", "cosine", "tan", "atan2", "tanh", "logistic", "erf"),
}


def program_of(work: Work) -> dict[str, Any]:
    """Counts of a turn's arithmetic as traced and as compiled, their ratio, and loop and fusions.

    The compiled program's operations on one number a place are those of the turn: slices and their
    choice of lanes work on the whole pool.
    """
    (common, seats), shares = begun(work), extent()
    compiled: Any = advance.lower((common, shares, one_device()), seats).compile()
    text = compiled.compiled.as_text()
    traced = traced_operations(common, jax.tree.map(lambda leaf: leaf[0], seats))
    made = compiled_operations(text, shares.places)
    return {
        "operations traced": traced,
        "operations compiled": made,
        "duplication": made / traced,
        "fusions": len(re.findall(r" fusion\(", text)),
        "native loops": text.count("xla_cpu_small_call"),
    }


def traced_operations(common: Common, seat: Seat) -> int:
    """Arithmetic operations in the jaxpr of one lane's turn."""

    def one(seat: Seat) -> Any:
        task = seat.task
        orders = Orders(task.end_time, task.first_step, (jnp.inf,) * WINDOW, common.capacity)
        return turn(common.plan, common.scene(task), seat.lane, orders)

    return jaxpr_operations(eqx.filter_make_jaxpr(one)(seat)[0].jaxpr)


def jaxpr_operations(jaxpr: Any) -> int:
    """Arithmetic operations on floats in a jaxpr and those inside it."""
    total = 0
    for equation in jaxpr.eqns:
        inside = [value for value in equation.params.values() if hasattr(value, "jaxpr")]
        total += sum(jaxpr_operations(closed.jaxpr) for closed in inside)
        floating = equation.outvars[0].aval.dtype == np.float64
        total += not inside and floating and equation.primitive.name in JAXPR
    return total


def compiled_operations(text: str, places: int) -> int:
    """Arithmetic operations on (places,) floats in optimised HLO, those in fusions included."""
    found = re.findall(rf"= f64\[{places}\]\{{0\}} ([a-z0-9-]+)\(", text)
    return sum(count for name, count in Counter(found).items() if name in HLO)
