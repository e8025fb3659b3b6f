"""Primitives of JAX that work element by element, as operations on scalars.

Each rule takes the operations to build with, the kind of the result, the equation's parameters and
the arguments, and gives the result. The same rules serve vectors of tangents.
"""

import math
from collections.abc import Callable, Mapping

from .elementary import ELEMENTARY
from .elementary import power as float_power
from .llvm_text import LIBRARY
from .operations import Number, Operations, Value

Parameters = Mapping[str, object]
Rule = Callable[..., Value]


def like(do: Operations, value: Value, number: Number) -> Value:
    """A number in the kind of a value."""
    kind = do.kinds[value]
    constant = do.constant(kind[0], number)
    return do.do("splat", kind, constant) if kind.endswith("p") else constant


def condition_kind(do: Operations, value: Value) -> str:
    """The kind of a comparison of values of the kind of one."""
    return "bp" if do.kinds[value].endswith("p") else "b"


def _arithmetic(name: str) -> Rule:
    def rule(do: Operations, kind: str, parameters: Parameters, a: Value, b: Value) -> Value:
        if kind[0] == "f":
            return do.do(f"f{name}", kind, a, b)
        if kind[0] == "b":
            return do.do({"add": "or", "mul": "and", "sub": "xor"}[name], kind, a, b)
        return do.do(name, kind, a, b)

    return rule


def _compare(name: str) -> Rule:
    def rule(do: Operations, kind: str, parameters: Parameters, a: Value, b: Value) -> Value:
        if do.kinds[a][0] == "b":
            if name == "ne":
                return do.do("xor", kind, a, b)
            if name == "eq":
                return do.do("not", kind, do.do("xor", kind, a, b))
            wide = "ip" if kind.endswith("p") else "i"
            a, b = (do.do("bool_to_int", wide, x) for x in (a, b))
        return do.do(("f" if do.kinds[a][0] == "f" else "i") + name, kind, a, b)

    return rule


def _compare_totally(name: str) -> Rule:
    """Comparison in an order in which NaN follows all numbers."""

    def rule(do: Operations, kind: str, parameters: Parameters, a: Value, b: Value) -> Value:
        if do.kinds[a][0] != "f":
            return _compare(name)(do, kind, parameters, a, b)
        a_is_nan, b_is_nan = (do.do("is_nan_either", kind, x, x) for x in (a, b))
        less = do.do(f"f{name}", kind, a, b)
        if name == "eq":
            return do.do("or", kind, less, do.do("and", kind, a_is_nan, b_is_nan))
        last = b_is_nan
        if name == "lt":
            last = do.do("and", kind, b_is_nan, do.do("not", kind, a_is_nan))
        return do.do("or", kind, less, last)

    return rule


def _extreme(name: str) -> Rule:
    """The larger or smaller of two; NaN if one is."""

    def rule(do: Operations, kind: str, parameters: Parameters, a: Value, b: Value) -> Value:
        if kind[0] == "b":
            return do.do("or" if name == "gt" else "and", kind, a, b)
        condition = condition_kind(do, a)
        if kind[0] != "f":
            return do.do("select", kind, do.do(f"i{name}", condition, a, b), a, b)
        if _is_number(do, b):
            a, b = b, a
        # One instruction of processors, which gives the second where either is NaN.
        found = do.do("select", kind, do.do(f"f{name}", condition, a, b), a, b)
        if _is_number(do, a):
            return found
        return do.do("select", kind, do.do("is_nan_either", condition, a, a), a, found)

    return rule


def _is_number(do: Operations, value: Value) -> bool:
    known = do.repeated_number(value)
    return isinstance(known, float) and not math.isnan(known)


def _divide(do: Operations, kind: str, parameters: Parameters, a: Value, b: Value) -> Value:
    if kind[0] == "f":
        return do.do("fdiv", kind, a, b)
    return _whole_division(do, kind, "divide_whole", a, b, like(do, a, -1))


def _whole_division(
    do: Operations, kind: str, name: str, a: Value, b: Value, by_zero: Value
) -> Value:
    """A division of integers, with a result for division by zero."""
    is_zero = do.do("ieq", condition_kind(do, a), b, like(do, a, 0))
    divisor = do.do("select", kind, is_zero, like(do, a, 1), b)
    return do.do("select", kind, is_zero, by_zero, do.do(name, kind, a, divisor))


def _unary(name: str) -> Rule:
    def rule(do: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
        return do.do(name, kind, a)

    return rule


def _library(name: str) -> Rule:
    def rule(do: Operations, kind: str, parameters: Parameters, *arguments: Value) -> Value:
        return do.do(name, kind, *arguments)

    return rule


def _negative(do: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    if kind[0] == "f":
        return do.do("fneg", kind, a)
    return do.do("sub", kind, like(do, a, 0), a)


def _absolute(do: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    if kind[0] == "f":
        return do.do("abs", kind, a)
    negative = do.do("ilt", condition_kind(do, a), a, like(do, a, 0))
    return do.do("select", kind, negative, do.do("sub", kind, like(do, a, 0), a), a)


def _sign(do: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    condition, zero = condition_kind(do, a), like(do, a, 0)
    prefix = "f" if kind[0] == "f" else "i"
    above = do.do(f"{prefix}gt", condition, a, zero)
    below = do.do(f"{prefix}lt", condition, a, zero)
    lower = do.do("select", kind, below, like(do, a, -1), a if prefix == "f" else zero)
    return do.do("select", kind, above, like(do, a, 1), lower)


def _is_finite(do: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    size = do.do("abs", do.kinds[a], a)
    return do.do("flt", kind, size, like(do, a, math.inf))


def power(do: Operations, kind: str, base: Value, exponent: int) -> Value:
    """A whole power, by squares."""
    if exponent < 0:
        return do.do("fdiv", kind, like(do, base, 1), power(do, kind, base, -exponent))
    if exponent == 0:
        return like(do, base, 1)
    product = "fmul" if kind[0] == "f" else "mul"
    result: Value | None = None
    while exponent:
        if exponent & 1:
            result = base if result is None else do.do(product, kind, result, base)
        exponent >>= 1
        if exponent:
            base = do.do(product, kind, base, base)
    assert result is not None
    return result


def _integer_power(do: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    exponent = parameters["y"]
    assert isinstance(exponent, int)
    return power(do, kind, a, exponent)


def _power(do: Operations, kind: str, parameters: Parameters, a: Value, b: Value) -> Value:
    if do.kinds[b][0] != "f":
        b = convert(do, kind, b)
    return float_power(do, kind, a, b)


def _round(do: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    to_even = int(parameters["rounding_method"]) == 1  # pyright: ignore
    return do.do("round_even" if to_even else "round_away", kind, a)


def _clamp(
    do: Operations, kind: str, parameters: Parameters, low: Value, a: Value, high: Value
) -> Value:
    above = _extreme("gt")(do, kind, parameters, a, low)
    return _extreme("lt")(do, kind, parameters, above, high)


def _not(do: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    return do.do("not", kind, a)


def _logic(name: str) -> Rule:
    def rule(do: Operations, kind: str, parameters: Parameters, a: Value, b: Value) -> Value:
        return do.do(name, kind, a, b)

    return rule


def _square(do: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    return power(do, kind, a, 2)


def _one_minus_square(do: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    """A product, which is accurate where the square is close to one; a primitive from JAX 0.11 on,
    in derivatives of tanh and others."""
    one = like(do, a, 1)
    above, below = (_arithmetic(n)(do, kind, parameters, one, a) for n in ("add", "sub"))
    return _arithmetic("mul")(do, kind, parameters, above, below)


def _inverse_root(do: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    return do.do("fdiv", kind, like(do, a, 1), do.do("sqrt", kind, a))


def _logistic(do: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    small = ELEMENTARY["exp"](do, kind, parameters, do.do("fneg", kind, a))
    return do.do("fdiv", kind, like(do, a, 1), do.do("fadd", kind, like(do, a, 1), small))


def _logarithm_of_base_two(do: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    """As XLA; a primitive from JAX 0.11 on."""
    natural = ELEMENTARY["log"](do, kind, parameters, a)
    return do.do("fmul", kind, natural, like(do, a, 1 / math.log(2)))


def _polynomial(
    do: Operations, kind: str, parameters: Parameters, x: Value, *coefficients: Value
) -> Value:
    """By Horner's rule, of coefficients of which the constant is first; a primitive from JAX 0.12
    on."""
    total = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        product = _arithmetic("mul")(do, kind, parameters, total, x)
        total = _arithmetic("add")(do, kind, parameters, product, coefficient)
    return total


def _remainder(do: Operations, kind: str, parameters: Parameters, a: Value, b: Value) -> Value:
    if kind[0] != "f":
        return _whole_division(do, kind, "remainder_whole", a, b, a)
    return do.do("fmod", kind, a, b)


def _copy(do: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    return a


def select(do: Operations, kind: str, parameters: Parameters, which: Value, *cases: Value) -> Value:
    """The case that a bool or an integer chooses."""
    if do.kinds[which][0] == "b":
        return do.do("select", kind, which, cases[1], cases[0])
    chosen = cases[-1]
    for number in reversed(range(len(cases) - 1)):
        is_lower = do.do("ile", condition_kind(do, which), which, like(do, which, number))
        chosen = do.do("select", kind, is_lower, cases[number], chosen)
    return chosen


def convert(do: Operations, kind: str, value: Value) -> Value:
    """A value in another kind."""
    old, new, suffix = do.kinds[value][0], kind[0], kind[1:]
    if old == new:
        return value
    if old == "b":
        if new == "f":
            return do.do("bool_to_float", kind, value)
        wide = do.do("bool_to_int", f"i{suffix}", value)
        return wide if new == "i" else do.do("narrow", kind, wide)
    if new == "b":
        name = "float_to_bool" if old == "f" else "int_to_bool"
        return do.do(name, kind, value)
    if new == "f":
        return do.do("int_to_float", kind, value)
    if old == "f":
        return do.do("float_to_int", kind, value)
    return do.do("widen" if new == "i" else "narrow", kind, value)


def _convert(do: Operations, kind: str, parameters: Parameters, value: Value) -> Value:
    return convert(do, kind, value)


RULES: dict[str, Rule] = {
    "add": _arithmetic("add"),
    "add_any": _arithmetic("add"),
    "sub": _arithmetic("sub"),
    "mul": _arithmetic("mul"),
    "div": _divide,
    **{name: _compare(name) for name in ("lt", "le", "gt", "ge", "eq", "ne")},
    **{f"{name}_to": _compare_totally(name) for name in ("lt", "le", "eq")},
    "max": _extreme("gt"),
    "min": _extreme("lt"),
    "neg": _negative,
    "abs": _absolute,
    "sign": _sign,
    "is_finite": _is_finite,
    "integer_pow": _integer_power,
    "square": _square,
    "one_minus_square": _one_minus_square,
    "pow": _power,
    "sqrt": _unary("sqrt"),
    "rsqrt": _inverse_root,
    "floor": _unary("floor"),
    "ceil": _unary("ceil"),
    "round": _round,
    "clamp": _clamp,
    "not": _not,
    **{name: _logic(name) for name in ("and", "or", "xor")},
    "logistic": _logistic,
    "log2": _logarithm_of_base_two,
    "polynomial": _polynomial,
    "rem": _remainder,
    "select_n": select,
    "convert_element_type": _convert,
    **dict.fromkeys(("copy", "copy_p", "stop_gradient", "optimization_barrier"), _copy),
    **{name: _library(name) for name in LIBRARY if name not in ("fmod", "pow")},
    **ELEMENTARY,
}
"""Rules by the names of primitives."""
