"""Arithmetic in a program: what is traced, and what the compiler makes of it.

Counted are operations that make a float of floats; not counted are comparisons and selections.
"""

import re
from collections import Counter
from typing import Any

import numpy as np

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
