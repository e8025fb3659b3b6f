"""Primitives that work element by element, as operations on scalars.

Each rule takes the operations to add to, the kind of the result, the equation's parameters and the
arguments, and returns the result. The same rules serve vectors of tangents.
"""

import math
from collections.abc import Callable, Mapping

from .elementary import ELEMENTARY
from .elementary import power as float_power
from .llvm_text import LIBRARY
from .operations import Number, Operations, Value

Parameters = Mapping[str, object]
Rule = Callable[..., Value]


def like(ops: Operations, value: Value, number: Number) -> Value:
    """Return `number` as a constant of the same kind as `value`."""
    kind = ops.kinds[value]
    constant = ops.constant(kind[0], number)
    return ops.emit("splat", kind, constant) if kind.endswith("p") else constant


def condition_kind(ops: Operations, value: Value) -> str:
    """Return the kind of the result if values of the kind of `value` are compared."""
    return "bp" if ops.kinds[value].endswith("p") else "b"


def _direct(name: str) -> Rule:
    """Return the rule that emits the operation `name` for arguments of any kind."""

    def rule(ops: Operations, kind: str, parameters: Parameters, *arguments: Value) -> Value:
        return ops.emit(name, kind, *arguments)

    return rule


def _arithmetic(name: str) -> Rule:
    def rule(ops: Operations, kind: str, parameters: Parameters, a: Value, b: Value) -> Value:
        if kind[0] == "f":
            return ops.emit(f"f{name}", kind, a, b)
        if kind[0] == "b":
            return ops.emit({"add": "or", "mul": "and", "sub": "xor"}[name], kind, a, b)
        return ops.emit(name, kind, a, b)

    return rule


def _compare(name: str) -> Rule:
    def rule(ops: Operations, kind: str, parameters: Parameters, a: Value, b: Value) -> Value:
        if ops.kinds[a][0] == "b":
            if name == "ne":
                return ops.emit("xor", kind, a, b)
            if name == "eq":
                return ops.emit("not", kind, ops.emit("xor", kind, a, b))
            wide = "ip" if kind.endswith("p") else "i"
            a, b = (ops.emit("bool_to_int", wide, x) for x in (a, b))
        return ops.emit(("f" if ops.kinds[a][0] == "f" else "i") + name, kind, a, b)

    return rule


def _compare_totally(name: str) -> Rule:
    """Return the rule for a comparison in a total order, in which NaN follows all numbers."""

    def rule(ops: Operations, kind: str, parameters: Parameters, a: Value, b: Value) -> Value:
        if ops.kinds[a][0] != "f":
            return _compare(name)(ops, kind, parameters, a, b)
        a_is_nan, b_is_nan = (ops.emit("is_nan_either", kind, x, x) for x in (a, b))
        numbers = ops.emit(f"f{name}", kind, a, b)
        if name == "eq":
            return ops.emit("or", kind, numbers, ops.emit("and", kind, a_is_nan, b_is_nan))
        with_nan = b_is_nan
        if name == "lt":
            with_nan = ops.emit("and", kind, b_is_nan, ops.emit("not", kind, a_is_nan))
        return ops.emit("or", kind, numbers, with_nan)

    return rule


def _extreme(name: str) -> Rule:
    """Return the rule for the larger ("gt") or smaller ("lt") of two values; NaN if one is NaN."""

    def rule(ops: Operations, kind: str, parameters: Parameters, a: Value, b: Value) -> Value:
        if kind[0] == "b":
            return ops.emit("or" if name == "gt" else "and", kind, a, b)
        condition = condition_kind(ops, a)
        if kind[0] != "f":
            return ops.emit("select", kind, ops.emit(f"i{name}", condition, a, b), a, b)
        if _is_number(ops, b):
            a, b = b, a
        # One instruction of x86 processors, which returns the second if either is NaN: correct if
        # only the second can be NaN.
        extreme = ops.emit("select", kind, ops.emit(f"f{name}", condition, a, b), a, b)
        if _is_number(ops, a):
            return extreme
        return ops.emit("select", kind, ops.emit("is_nan_either", condition, a, a), a, extreme)

    return rule


def _is_number(ops: Operations, value: Value) -> bool:
    known = ops.repeated_number(value)
    return isinstance(known, float) and not math.isnan(known)


def _divide(ops: Operations, kind: str, parameters: Parameters, a: Value, b: Value) -> Value:
    if kind[0] == "f":
        return ops.emit("fdiv", kind, a, b)
    return _whole_division(ops, kind, "divide_whole", a, b, like(ops, a, -1))


def _whole_division(
    ops: Operations, kind: str, name: str, a: Value, b: Value, by_zero: Value
) -> Value:
    """Divide integers; a division by zero, which LLVM leaves undefined, returns `by_zero`."""
    is_zero = ops.emit("ieq", condition_kind(ops, a), b, like(ops, a, 0))
    divisor = ops.emit("select", kind, is_zero, like(ops, a, 1), b)
    return ops.emit("select", kind, is_zero, by_zero, ops.emit(name, kind, a, divisor))


def _negative(ops: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    if kind[0] == "f":
        return ops.emit("fneg", kind, a)
    return ops.emit("sub", kind, like(ops, a, 0), a)


def _absolute(ops: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    if kind[0] == "f":
        return ops.emit("abs", kind, a)
    negative = ops.emit("ilt", condition_kind(ops, a), a, like(ops, a, 0))
    return ops.emit("select", kind, negative, ops.emit("sub", kind, like(ops, a, 0), a), a)


def _sign(ops: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    condition, zero = condition_kind(ops, a), like(ops, a, 0)
    prefix = "f" if kind[0] == "f" else "i"
    above = ops.emit(f"{prefix}gt", condition, a, zero)
    below = ops.emit(f"{prefix}lt", condition, a, zero)
    lower = ops.emit("select", kind, below, like(ops, a, -1), a if prefix == "f" else zero)
    return ops.emit("select", kind, above, like(ops, a, 1), lower)


def _is_finite(ops: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    magnitude = ops.emit("abs", ops.kinds[a], a)
    return ops.emit("flt", kind, magnitude, like(ops, a, math.inf))


def power(ops: Operations, kind: str, base: Value, exponent: int) -> Value:
    """Compute an integer power by repeated squaring."""
    if exponent < 0:
        return ops.emit("fdiv", kind, like(ops, base, 1), power(ops, kind, base, -exponent))
    if exponent == 0:
        return like(ops, base, 1)
    product = "fmul" if kind[0] == "f" else "mul"
    result: Value | None = None
    while exponent:
        if exponent & 1:
            result = base if result is None else ops.emit(product, kind, result, base)
        exponent >>= 1
        if exponent:
            base = ops.emit(product, kind, base, base)
    assert result is not None
    return result


def _integer_power(ops: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    exponent = parameters["y"]
    assert isinstance(exponent, int)
    return power(ops, kind, a, exponent)


def _power(ops: Operations, kind: str, parameters: Parameters, a: Value, b: Value) -> Value:
    if ops.kinds[b][0] != "f":
        b = convert(ops, kind, b)
    return float_power(ops, kind, a, b)


def _round(ops: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    to_even = int(parameters["rounding_method"]) == 1  # pyright: ignore
    return ops.emit("round_even" if to_even else "round_away", kind, a)


def _clamp(
    ops: Operations, kind: str, parameters: Parameters, low: Value, a: Value, high: Value
) -> Value:
    above = _extreme("gt")(ops, kind, parameters, a, low)
    return _extreme("lt")(ops, kind, parameters, above, high)


def _square(ops: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    return power(ops, kind, a, 2)


def _inverse_root(ops: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    return ops.emit("fdiv", kind, like(ops, a, 1), ops.emit("sqrt", kind, a))


def _logistic(ops: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    exponential = ELEMENTARY["exp"](ops, kind, parameters, ops.emit("fneg", kind, a))
    return ops.emit(
        "fdiv", kind, like(ops, a, 1), ops.emit("fadd", kind, like(ops, a, 1), exponential)
    )


def _one_minus_square(ops: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    """1 - a^2 as (1 + a)(1 - a), which is accurate if the square is close to one.

    A primitive from JAX 0.11 on, in derivatives of tanh for instance.
    """
    one = like(ops, a, 1)
    above, below = (_arithmetic(n)(ops, kind, parameters, one, a) for n in ("add", "sub"))
    return _arithmetic("mul")(ops, kind, parameters, above, below)


def _logarithm_of_base_two(ops: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    """The same formula as XLA's. A primitive from JAX 0.11 on."""
    natural = ELEMENTARY["log"](ops, kind, parameters, a)
    return ops.emit("fmul", kind, natural, like(ops, a, 1 / math.log(2)))


def _polynomial(
    ops: Operations, kind: str, parameters: Parameters, x: Value, *coefficients: Value
) -> Value:
    """Horner's rule; the constant coefficient is first. A primitive from JAX 0.12 on."""
    total = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        product = _arithmetic("mul")(ops, kind, parameters, total, x)
        total = _arithmetic("add")(ops, kind, parameters, product, coefficient)
    return total


def _remainder(ops: Operations, kind: str, parameters: Parameters, a: Value, b: Value) -> Value:
    if kind[0] != "f":
        return _whole_division(ops, kind, "remainder_whole", a, b, a)
    return ops.emit("fmod", kind, a, b)


def _copy(ops: Operations, kind: str, parameters: Parameters, a: Value) -> Value:
    return a


def select(
    ops: Operations, kind: str, parameters: Parameters, index: Value, *cases: Value
) -> Value:
    """Return the case that a bool or an integer selects."""
    if ops.kinds[index][0] == "b":
        return ops.emit("select", kind, index, cases[1], cases[0])
    result = cases[-1]
    for number in reversed(range(len(cases) - 1)):
        is_case = ops.emit("ile", condition_kind(ops, index), index, like(ops, index, number))
        result = ops.emit("select", kind, is_case, cases[number], result)
    return result


def convert(ops: Operations, kind: str, value: Value) -> Value:
    """Convert a value to another kind."""
    old, new, suffix = ops.kinds[value][0], kind[0], kind[1:]
    if old == new:
        return value
    if old == "b":
        if new == "f":
            return ops.emit("bool_to_float", kind, value)
        wide = ops.emit("bool_to_int", f"i{suffix}", value)
        return wide if new == "i" else ops.emit("narrow", kind, wide)
    if new == "b":
        return ops.emit("fne" if old == "f" else "ine", kind, value, like(ops, value, 0))
    if new == "f":
        return ops.emit("int_to_float", kind, value)
    if old == "f":
        return ops.emit("float_to_int", kind, value)
    return ops.emit("widen" if new == "i" else "narrow", kind, value)


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
    "sqrt": _direct("sqrt"),
    "rsqrt": _inverse_root,
    "floor": _direct("floor"),
    "ceil": _direct("ceil"),
    "round": _round,
    "clamp": _clamp,
    "not": _direct("not"),
    **{name: _direct(name) for name in ("and", "or", "xor")},
    "logistic": _logistic,
    "log2": _logarithm_of_base_two,
    "polynomial": _polynomial,
    "rem": _remainder,
    "select_n": select,
    "convert_element_type": lambda ops, kind, parameters, value: convert(ops, kind, value),
    **dict.fromkeys(("copy", "copy_p", "stop_gradient", "optimization_barrier"), _copy),
    **{name: _direct(name) for name in LIBRARY if name not in ("fmod", "pow")},
    **ELEMENTARY,
}
"""Rules by the names of primitives."""
