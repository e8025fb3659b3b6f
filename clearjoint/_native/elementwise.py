"""Rules by which JAX's primitives that work element by element become operations of a program.

A rule takes the arguments of a primitive as `Symbol`s and returns the result as one; the operators
of symbols add operations to the program. The same rules serve scalars and vectors of tangents.
"""

import math
import operator
from collections.abc import Callable

import numpy as np
from numpy.typing import DTypeLike

from .elementary import ELEMENTARY
from .elementary import power as float_power
from .llvm_text import LIBRARY
from .operations import KINDS, Operations, Symbol, Value

Rule = Callable[..., Symbol]
"""Function of a primitive's arguments, and of its parameter in `PARAMETERS` if there is one."""
PARAMETERS = {
    "mul": "out_dtype",
    "integer_pow": "y",
    "round": "rounding_method",
    "convert_element_type": "new_dtype",
}
"""By the name of a primitive, the name of the parameter that its rule takes as last argument."""
WITHOUT_EFFECT = ("weak_type",)
"""Parameters of primitives that do not change the numbers of results."""
FLOAT_OPERATIONS = {
    **{name: f"f{name}" for name in ("add", "sub", "mul", "div", "neg")},
    "add_any": "fadd",
}
"""By the name of a primitive, the operation that its rule adds for single floats. Most equations of
a program have such an operation. Without the rule's `Symbol`s, it is added in half of the time."""
IDENTITIES = ("copy", "stop_gradient", "optimization_barrier")
"""Primitives whose results are their arguments."""


def apply(ops: Operations, name: str, *values: Value, parameter: object = None) -> Value:
    """Add the operations of the elementwise primitive `name` for given values to a program, and
    return the result. `parameter`: value of the primitive's parameter in `PARAMETERS`, if any."""
    arguments: list[object] = [Symbol(ops, value) for value in values]
    if parameter is not None:
        arguments.append(parameter)
    return RULES[name](*arguments).value


def _direct(name: str) -> Rule:
    return lambda a, *others: a.emit(name, *others)


def _compare(name: str) -> Rule:
    def rule(a: Symbol, b: Symbol) -> Symbol:
        if a.letter == "b":
            # Equality of bools is a logical operation; to be ordered, they become integers.
            if name in ("eq", "ne"):
                return a ^ b if name == "ne" else ~(a ^ b)
            a, b = convert(a, "i"), convert(b, "i")
        return a.compare(name, b)

    return rule


def _compare_totally(name: str) -> Rule:
    """Return the rule of the comparison "lt", "le" or "eq" as for sorting: NaN is larger than all
    numbers and equals NaN."""

    def rule(a: Symbol, b: Symbol) -> Symbol:
        if a.letter != "f":
            return _compare(name)(a, b)
        numbers = a.compare(name, b)
        if name == "eq":
            return numbers | (a.is_nan() & b.is_nan())
        # NaN is the largest: every a is less than or equal to it, and every number is less.
        return numbers | (b.is_nan() if name == "le" else b.is_nan() & ~a.is_nan())

    return rule


def _extreme(name: str) -> Rule:
    """Return the rule for the larger ("gt") or smaller ("lt") of two values; NaN if one is NaN."""

    def rule(a: Symbol, b: Symbol) -> Symbol:
        if a.letter == "b":
            return a | b if name == "gt" else a & b
        if a.letter != "f":
            return a.compare(name, b).select(a, b)
        # A known number becomes the first, which saves the test for NaN below.
        if _is_number(b):
            a, b = b, a
        # One instruction of x86 processors, which returns the second if either is NaN: correct if
        # only the second can be NaN.
        extreme = a.compare(name, b).select(a, b)
        return extreme if _is_number(a) else a.is_nan().select(a, extreme)

    return rule


def _is_number(a: Symbol) -> bool:
    """Return whether a float, or each element of a vector, has a known value other than NaN."""
    number = a.ops.repeated_number(a.value)
    return isinstance(number, float) and not math.isnan(number)


def _multiply(a: Symbol, b: Symbol, dtype: DTypeLike | None = None) -> Symbol:
    return a * b if dtype is None else _convert(a, dtype) * _convert(b, dtype)


def _divide(a: Symbol, b: Symbol) -> Symbol:
    """Return a / b; for integers, rounded towards zero, and -1 if b is 0, as in XLA."""
    return a / b if a.letter == "f" else _whole_division("divide_whole", a, b, a.like(-1), -a)


def _whole_division(
    name: str, a: Symbol, b: Symbol, by_zero: Symbol, by_minus_one: Symbol
) -> Symbol:
    """Return the quotient or remainder of integers, by the operation `name`; `by_zero` if b is 0,
    and `by_minus_one` if b is -1. LLVM leaves division by 0, and division of the least integer by
    -1, undefined."""
    # For these divisors the operation divides by one, and its result is not used.
    is_zero, is_minus_one = b.compare("eq", 0), b.compare("eq", -1)
    quotient = a.emit(name, (is_zero | is_minus_one).select(b.like(1), b))
    return is_zero.select(by_zero, is_minus_one.select(by_minus_one, quotient))


def _sign(a: Symbol) -> Symbol:
    above, below = a.compare("gt", 0), a.compare("lt", 0)
    # A float that is neither is a zero, which keeps its sign, or NaN.
    return above.select(a.like(1), below.select(a.like(-1), a if a.letter == "f" else a.like(0)))


def _integer_power(a: Symbol, exponent: int) -> Symbol:
    if exponent < 0:
        return a.like(1) / _integer_power(a, -exponent)
    # The product of those powers a, a^2, a^4, ... whose bit in the exponent is one.
    result: Symbol | None = None
    while exponent:
        if exponent & 1:
            result = a if result is None else result * a
        exponent >>= 1
        if exponent:
            a = a * a
    return a.like(1) if result is None else result


def clamp(low: Symbol, a: Symbol, high: Symbol) -> Symbol:
    return _extreme("lt")(_extreme("gt")(a, low), high)


def _polynomial(x: Symbol, *coefficients: Symbol) -> Symbol:
    """Return a polynomial of x by Horner's rule, from its coefficients, the constant first."""
    total = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        total = total * x + coefficient
    return total


def _remainder(a: Symbol, b: Symbol) -> Symbol:
    """Return a - n b, where n is a/b rounded towards zero. For integers and b = 0, return a."""
    if a.letter == "f":
        return a.emit("fmod", b)
    return _whole_division("remainder_whole", a, b, a, a.like(0))


def _select(index: Symbol, *cases: Symbol) -> Symbol:
    """Return the case with the given index, a bool or an integer clamped to the range of cases."""
    if index.letter == "b":
        return index.select(cases[1], cases[0])
    result = cases[-1]
    for number in reversed(range(len(cases) - 1)):
        result = index.compare("le", number).select(cases[number], result)
    return result


def convert(a: Symbol, letter: str) -> Symbol:
    """Convert a value to a kind: `letter` "f" (float64), "i" (int64), "w" (int32) or "b" (bool). A
    float that becomes an integer loses its fraction; one beyond the integers' range becomes the
    nearest integer, and NaN zero. An int64 that becomes an int32 keeps its lower 32 bits."""
    old = a.letter
    if old == letter:
        return a
    if old == "b":
        if letter == "f":
            return a.emit("bool_to_float", letter="f")
        wide = a.emit("bool_to_int", letter="i")
        return wide if letter == "i" else wide.emit("narrow", letter="w")
    if letter == "b":
        return a.compare("ne", 0)
    if "f" in (old, letter):
        return a.emit("int_to_float" if letter == "f" else "float_to_int", letter=letter)
    return a.emit("widen" if letter == "i" else "narrow", letter=letter)


def _convert(a: Symbol, dtype: DTypeLike) -> Symbol:
    """Convert a value to a dtype. An integer that is converted to uint32, which is computed in
    int64, keeps its higher bits, and `Lowering` cuts them off."""
    if a.letter == "f" and np.dtype(dtype) == np.uint32:
        # A float beyond the range of uint32 becomes the nearest integer of that range.
        a = clamp(a.like(0), a, a.like((1 << 32) - 1))
    return convert(a, KINDS[np.dtype(dtype).name])


RULES: dict[str, Rule] = {
    "add": operator.add,
    "add_any": operator.add,
    "sub": operator.sub,
    "mul": _multiply,
    "div": _divide,
    **{name: _compare(name) for name in ("lt", "le", "gt", "ge", "eq", "ne")},
    **{f"{name}_to": _compare_totally(name) for name in ("lt", "le", "eq")},
    "max": _extreme("gt"),
    "min": _extreme("lt"),
    "neg": operator.neg,
    "abs": lambda a: a.emit("abs") if a.letter == "f" else a.compare("lt", 0).select(-a, a),
    "sign": _sign,
    "is_finite": lambda a: a.emit("abs").compare("lt", math.inf),
    "integer_pow": _integer_power,
    "square": lambda a: a * a,
    "one_minus_square": lambda a: (a.like(1) + a) * (a.like(1) - a),  # from JAX 0.11 on
    "pow": lambda a, b: float_power(a, convert(b, "f")),
    "rsqrt": lambda a: a.like(1) / a.emit("sqrt"),
    "round": lambda a, method: a.emit("round_even" if int(method) == 1 else "round_away"),
    "clamp": clamp,
    "logistic": lambda a: a.like(1) / (a.like(1) + ELEMENTARY["exp"](-a)),
    "log2": lambda a: ELEMENTARY["log"](a) * (1 / math.log(2)),  # from JAX 0.11 on; as XLA does
    "polynomial": _polynomial,  # from JAX 0.12 on
    "rem": _remainder,
    "select_n": _select,
    "convert_element_type": _convert,
    **{name: _direct(name) for name in ("sqrt", "floor", "ceil", "not", "and", "or", "xor")},
    **{name: _direct(name) for name in LIBRARY if name not in ("fmod", "pow", "atan2")},
} | ELEMENTARY
"""Rules by the names of primitives."""
