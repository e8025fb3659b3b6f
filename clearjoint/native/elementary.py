"""Elementary functions as arithmetic, which vectors of lanes and tangents carry out side by side.

Reduction by fused multiply-adds (Cody and Waite) and the polynomials of Sun's fdlibm: errors stay
below one unit in the last place (measured against the C library by the tests). Arguments beyond
`LARGEST_ANGLE` are left to the C library.
"""

import math
from collections.abc import Callable, Sequence

from .operations import Number, Operations, Value

LARGEST_ANGLE = 1e8
"""Of sines and cosines that are computed here; rad."""
_HALF_PI = (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591833e-33)
"""Pi/2 as a sum of three doubles."""
_ROUNDING = 6755399441055744.0
"""1.5 * 2**52: added to a number below 2**51, it leaves the nearest integer in the last bits."""
_SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
_COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)


class _Arithmetic:
    """Operations on values of one kind, floats or vectors of tangents."""

    def __init__(self, do: Operations, kind: str):
        self.do, self.kind = do, kind
        self.suffix = kind[1:]

    def constant(self, number: Number, kind: str = "f") -> Value:
        value = self.do.constant(kind, number)
        return self.do.do("splat", kind + self.suffix, value) if self.suffix else value

    def add(self, a: Value, b: Value) -> Value:
        return self.do.do("fadd", self.kind, a, b)

    def subtract(self, a: Value, b: Value) -> Value:
        return self.do.do("fsub", self.kind, a, b)

    def multiply(self, a: Value, b: Value) -> Value:
        return self.do.do("fmul", self.kind, a, b)

    def fused(self, a: Value, b: Value, c: Value) -> Value:
        """a b + c, rounded once."""
        return self.do.do("fma", self.kind, a, b, c)

    def polynomial(self, x: Value, coefficients: Sequence[float]) -> Value:
        """Coefficients by rising powers."""
        total = self.constant(coefficients[-1])
        for coefficient in reversed(coefficients[:-1]):
            total = self.fused(total, x, self.constant(coefficient))
        return total

    def bits(self, value: Value) -> Value:
        return self.do.do("float_bits", f"i{self.suffix}", value)

    def has_bit(self, whole: Value, bit: int) -> Value:
        masked = self.do.do("and", f"i{self.suffix}", whole, self.constant(bit, "i"))
        return self.do.do("int_to_bool", f"b{self.suffix}", masked)

    def select(self, condition: Value, yes: Value, no: Value) -> Value:
        return self.do.do("select", self.kind, condition, yes, no)


def _sine_and_cosine(do: Operations, kind: str, angle: Value) -> tuple[Value, Value, Value]:
    """Sine and cosine of an angle less a multiple of pi/2, and an integer with the multiple in its
    last bits."""
    a = _Arithmetic(do, kind)
    rounding = a.constant(_ROUNDING)
    shifted = a.fused(angle, a.constant(2.0 / math.pi), rounding)
    minus = do.do("fneg", kind, a.subtract(shifted, rounding))
    # The first difference is exact. Near multiples of pi/2 it is as small as the second one, so
    # the error of that sum is computed too (Knuth) and goes on as a tail.
    first, second = a.fused(minus, a.constant(_HALF_PI[0]), angle), a.constant(_HALF_PI[1])
    product = a.multiply(minus, second)
    x = a.add(first, product)
    moved = a.subtract(x, first)
    tail = a.add(a.subtract(first, a.subtract(x, moved)), a.subtract(product, moved))
    tail = a.add(tail, a.fused(minus, second, do.do("fneg", kind, product)))
    tail = a.fused(minus, a.constant(_HALF_PI[2]), tail)
    z = a.multiply(x, x)
    cube, half = a.multiply(z, x), a.constant(0.5)
    r = a.polynomial(z, _SINE[1:])
    inner = a.subtract(a.multiply(half, tail), a.multiply(cube, r))
    inner = a.subtract(a.multiply(z, inner), tail)
    sine = a.subtract(x, a.subtract(inner, a.multiply(cube, a.constant(_SINE[0]))))
    one, half_square = a.constant(1.0), a.multiply(half, z)
    head = a.subtract(one, half_square)
    rest = a.subtract(a.subtract(one, head), half_square)
    r = a.multiply(z, a.polynomial(z, _COSINE))
    rest = a.add(rest, a.subtract(a.multiply(z, r), a.multiply(x, tail)))
    return sine, a.add(head, rest), a.bits(shifted)


def _with_library(do: Operations, kind: str, name: str, angle: Value, usual: Value) -> Value:
    """The C library's result where any angle is too large, or none."""
    a = _Arithmetic(do, kind)
    size = do.do("abs", kind, angle)
    fits = do.do("fle", f"b{a.suffix}", size, a.constant(LARGEST_ANGLE))
    beyond = do.do("not", f"b{a.suffix}", fits)

    def rare() -> list[Value]:
        return [a.select(beyond, do.do(name, kind, angle), usual)]

    return do.branch(beyond, rare, lambda: [usual])[0]


def _sine(do: Operations, kind: str, parameters: object, angle: Value) -> Value:
    if do.number(angle) is not None:
        return do.constant("f", math.sin(float(do.constants[angle])))
    a = _Arithmetic(do, kind)
    sine, cosine, quarter = _sine_and_cosine(do, kind, angle)
    size = a.select(a.has_bit(quarter, 1), cosine, sine)
    usual = a.select(a.has_bit(quarter, 2), do.do("fneg", kind, size), size)
    return _with_library(do, kind, "sin", angle, usual)


def _cosine(do: Operations, kind: str, parameters: object, angle: Value) -> Value:
    if do.number(angle) is not None:
        return do.constant("f", math.cos(float(do.constants[angle])))
    a = _Arithmetic(do, kind)
    sine, cosine, quarter = _sine_and_cosine(do, kind, angle)
    size = a.select(a.has_bit(quarter, 1), sine, cosine)
    following = do.do("add", f"i{a.suffix}", quarter, a.constant(1, "i"))
    usual = a.select(a.has_bit(following, 2), do.do("fneg", kind, size), size)
    return _with_library(do, kind, "cos", angle, usual)


ELEMENTARY: dict[str, Callable[..., Value]] = {"sin": _sine, "cos": _cosine}
"""Rules, as those of `.elementwise`, by the names of primitives."""
