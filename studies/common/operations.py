"""Arithmetic in a program, as JAX traces it.

Counted are operations that make a float of floats; not counted are comparisons and selections.
"""

from typing import Any

import numpy as np

JAXPR = {
    *("add", "sub", "mul", "div", "neg", "abs", "sign", "max", "min", "rem", "floor"),
    *("pow", "integer_pow", "square", "sqrt", "rsqrt", "cbrt", "exp", "expm1", "log", "log1p"),
    *("sin", "cos", "tan", "atan2", "tanh", "logistic", "erf"),
}


def jaxpr_operations(jaxpr: Any) -> int:
    """Arithmetic operations on floats in a jaxpr and those inside it."""
    total = 0
    for equation in jaxpr.eqns:
        inside = [value for value in equation.params.values() if hasattr(value, "jaxpr")]
        total += sum(jaxpr_operations(closed.jaxpr) for closed in inside)
        floating = equation.outvars[0].aval.dtype == np.float64
        total += not inside and floating and equation.primitive.name in JAXPR
    return total
