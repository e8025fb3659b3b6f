"""Elementary functions as arithmetic, which vectors of lanes and tangents carry out side by side.

Sines and cosines: reduction by fused multiply-adds (Cody and Waite) and the polynomials of Sun's
fdlibm. Exponentials, logarithms, powers and hyperbolic tangents: sums of two doubles (Dekker) and
Taylor's polynomials of a reduced argument. Errors stay below one unit in the last place, as the
tests measure with mpmath: at most 0.95 for `expm1`, 0.8 for sines, cosines and `tanh`, and 0.7 for
the others.
Arguments outside the ranges given here, infinities and NaN are left to the C library.
"""

import math
from collections.abc import Callable, Sequence

from .operations import Number, Operations, Value

LARGEST_ANGLE = 1e8
"""Of sines and cosines that are computed here; rad."""
LARGEST_EXPONENT = 700.0
"""Of exponentials, and of a power's exponent times the logarithm of its base."""
LEAST_NORMAL, LARGEST_NUMBER = 2.2250738585072014e-308, 1.7976931348623157e308
"""Of bases and logarithms' arguments."""
_LN_2 = (0.6931471805598903, 5.497923018708371e-14)
"""As a sum of two doubles; whole multiples of the first are exact."""
_TWO_THIRDS = (2.0 / 3.0, 3.700743415417188e-17)
_LOGARITHM = tuple(2.0 / k for k in range(5, 29, 2))
"""Of the area tangent, from the fifth power on."""
_EXPONENTIAL = tuple(1.0 / math.factorial(k) for k in range(3, 15))
"""From the third power on."""
_LAST_TANH = 22.0
_ROOT_OF_HALF = 0x3FE6A09E667F3BCD
"""Its bits."""
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
        """Coefficients by rising powers; pairs are taken together, side by side (Estrin)."""
        terms = [self.constant(coefficient) for coefficient in coefficients]
        while len(terms) > 1:
            rest = terms[len(terms) // 2 * 2 :]
            pairs = zip(terms[::2], terms[1::2], strict=False)
            terms = [self.fused(high, x, low) for low, high in pairs] + rest
            x = self.multiply(x, x)
        return terms[0]

    def negative(self, a: Value) -> Value:
        return self.do.do("fneg", self.kind, a)

    def divide(self, a: Value, b: Value) -> Value:
        return self.do.do("fdiv", self.kind, a, b)

    def product(self, a: Value, b: Value) -> tuple[Value, Value]:
        """a b as a sum of two."""
        high = self.multiply(a, b)
        return high, self.fused(a, b, self.negative(high))

    def total(self, a: Value, b: Value) -> tuple[Value, Value]:
        """a + b as a sum of two (Knuth)."""
        high = self.add(a, b)
        moved = self.subtract(high, a)
        low = self.subtract(a, self.subtract(high, moved))
        return high, self.add(low, self.subtract(b, moved))

    def rounded(self, a: Value) -> tuple[Value, Value]:
        """The nearest integer as a float, and as an integer in the last bits of another."""
        shifted = self.add(a, self.constant(_ROUNDING))
        return self.subtract(shifted, self.constant(_ROUNDING)), self.bits(shifted)

    def scaled(self, a: Value, whole: Value) -> Value:
        """a times two to an integer, a normal number."""
        shift = self.whole("shift_left", whole, 52)
        return self.of_bits(self.do.do("add", f"i{self.suffix}", self.bits(a), shift))

    def whole(self, name: str, a: Value, number: int) -> Value:
        return self.do.do(name, f"i{self.suffix}", a, self.constant(number, "i"))

    def of_bits(self, whole: Value) -> Value:
        return self.do.do("float_of_bits", self.kind, whole)

    def within(self, least: float, value: Value, largest: float) -> Value:
        condition = f"b{self.suffix}"
        above = self.do.do("fge", condition, value, self.constant(least))
        return self.do.do(
            "and", condition, above, self.do.do("fle", condition, value, self.constant(largest))
        )

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


def _with_library(a: _Arithmetic, name: str, fits: Value, usual: Value, *given: Value) -> Value:
    """The C library's result in lanes in which arguments do not fit, if there is one."""
    beyond = a.do.do("not", f"b{a.suffix}", fits)

    def rare() -> list[Value]:
        return [a.select(beyond, a.do.do(name, a.kind, *given), usual)]

    return a.do.branch(beyond, rare, lambda: [usual])[0]


def _angle_fits(a: _Arithmetic, angle: Value) -> Value:
    return a.within(-LARGEST_ANGLE, angle, LARGEST_ANGLE)


def _sine(do: Operations, kind: str, parameters: object, angle: Value) -> Value:
    if do.number(angle) is not None:
        return do.constant("f", math.sin(float(do.constants[angle])))
    a = _Arithmetic(do, kind)
    sine, cosine, quarter = _sine_and_cosine(do, kind, angle)
    size = a.select(a.has_bit(quarter, 1), cosine, sine)
    usual = a.select(a.has_bit(quarter, 2), do.do("fneg", kind, size), size)
    return _with_library(a, "sin", _angle_fits(a, angle), usual, angle)


def _cosine(do: Operations, kind: str, parameters: object, angle: Value) -> Value:
    if do.number(angle) is not None:
        return do.constant("f", math.cos(float(do.constants[angle])))
    a = _Arithmetic(do, kind)
    sine, cosine, quarter = _sine_and_cosine(do, kind, angle)
    size = a.select(a.has_bit(quarter, 1), sine, cosine)
    following = do.do("add", f"i{a.suffix}", quarter, a.constant(1, "i"))
    usual = a.select(a.has_bit(following, 2), do.do("fneg", kind, size), size)
    return _with_library(a, "cos", _angle_fits(a, angle), usual, angle)


def _logarithm_of(a: _Arithmetic, x: Value) -> tuple[Value, Value]:
    """The logarithm of a positive normal number, as a sum of two."""
    # x = m 2**k with m between the roots of 1/2 and 2, and log m = 2 artanh((m - 1) / (m + 1)).
    bits = a.bits(x)
    above = a.whole("sub", bits, _ROOT_OF_HALF)
    k = a.whole("shift_right", above, 52)
    m = a.of_bits(a.do.do("sub", f"i{a.suffix}", bits, a.whole("shift_left", k, 52)))
    rounding = a.constant(_ROUNDING)
    number = a.subtract(a.of_bits(a.do.do("add", f"i{a.suffix}", k, a.bits(rounding))), rounding)
    one = a.constant(1.0)
    f, (divisor, rest) = a.subtract(m, one), a.total(m, one)
    inverse = a.divide(one, divisor)
    s = a.multiply(f, inverse)
    s_low = a.fused(a.negative(s), divisor, f)
    s_low = a.multiply(a.fused(a.negative(s), rest, s_low), inverse)
    square, square_low = a.product(s, s)
    square_low = a.fused(a.add(s, s), s_low, square_low)
    third, third_low = a.product(square, a.constant(_TWO_THIRDS[0]))
    third_low = a.fused(square, a.constant(_TWO_THIRDS[1]), third_low)
    third_low = a.fused(square_low, a.constant(_TWO_THIRDS[0]), third_low)
    tail = a.multiply(a.multiply(square, square), a.polynomial(square, _LOGARITHM))
    w = a.add(third, tail)
    w_low = a.add(a.add(a.subtract(third, w), tail), third_low)
    cubic, cubic_low = a.product(s, w)
    cubic_low = a.fused(s_low, w, a.fused(s, w_low, cubic_low))
    twice, twice_low = a.add(s, s), a.add(s_low, s_low)
    high = a.add(twice, cubic)
    low = a.add(a.add(a.add(a.subtract(twice, high), cubic), cubic_low), twice_low)
    first = a.multiply(number, a.constant(_LN_2[0]))
    result = a.add(first, high)
    low = a.fused(number, a.constant(_LN_2[1]), low)
    return result, a.add(a.add(a.subtract(first, result), high), low)


def _exponential_of(
    a: _Arithmetic, x: Value, x_low: Value
) -> tuple[Value, Value, tuple[Value, Value]]:
    """r, p and n in exp(x + x_low) = 2**n (1 + r + p), n as a float and as an integer."""
    n, whole = a.rounded(a.multiply(x, a.constant(1.0 / math.log(2.0))))
    minus = a.negative(n)
    r = a.fused(minus, a.constant(_LN_2[0]), x)
    r, r_low = a.total(r, a.fused(minus, a.constant(_LN_2[1]), x_low))
    cube = a.multiply(r, a.polynomial(r, _EXPONENTIAL))
    p = a.fused(a.multiply(r, r), a.add(a.constant(0.5), cube), r_low)
    return r, p, (n, whole)


def _exponential_from(a: _Arithmetic, x: Value, x_low: Value) -> Value:
    r, p, (_, n) = _exponential_of(a, x, x_low)
    one = a.constant(1.0)
    y = a.add(one, r)
    return a.scaled(a.add(y, a.add(a.subtract(r, a.subtract(y, one)), p)), n)


def _exponential_less_one(a: _Arithmetic, x: Value) -> tuple[Value, Value]:
    """exp(x) - 1 as a sum of two."""
    r, p, (_, n) = _exponential_of(a, x, a.constant(0.0))
    one = a.constant(1.0)
    scale = a.scaled(one, n)
    high, low = a.total(scale, a.negative(one))
    high, lower = a.total(high, a.multiply(scale, r))
    return a.total(high, a.add(a.add(low, lower), a.multiply(scale, p)))


def _exponential(do: Operations, kind: str, parameters: object, x: Value) -> Value:
    a = _Arithmetic(do, kind)
    usual = _exponential_from(a, x, a.constant(0.0))
    return _with_library(a, "exp", a.within(-LARGEST_EXPONENT, x, LARGEST_EXPONENT), usual, x)


def _expm1(do: Operations, kind: str, parameters: object, x: Value) -> Value:
    a = _Arithmetic(do, kind)
    usual = _keeping_zero(a, x, _exponential_less_one(a, x)[0])
    return _with_library(a, "expm1", a.within(-LARGEST_EXPONENT, x, LARGEST_EXPONENT), usual, x)


def _tanh(do: Operations, kind: str, parameters: object, x: Value) -> Value:
    """Of E = exp(2 |x|) - 1: E / (E + 2), which is one from `_LAST_TANH` on."""
    a = _Arithmetic(do, kind)
    size, last = do.do("abs", kind, x), a.constant(_LAST_TANH)
    size = a.select(do.do("fgt", f"b{a.suffix}", size, last), last, size)
    high, low = _exponential_less_one(a, a.add(size, size))
    divisor, rest = a.total(a.constant(2.0), high)
    q = a.divide(high, divisor)
    left = a.add(a.fused(a.negative(q), divisor, high), low)
    left = a.fused(a.negative(q), a.add(rest, low), left)
    return do.do("copysign", kind, a.add(q, a.divide(left, divisor)), x)


def _logarithm(do: Operations, kind: str, parameters: object, x: Value) -> Value:
    a = _Arithmetic(do, kind)
    fits = a.within(LEAST_NORMAL, x, LARGEST_NUMBER)
    return _with_library(a, "log", fits, a.add(*_logarithm_of(a, x)), x)


def _log1p(do: Operations, kind: str, parameters: object, x: Value) -> Value:
    a = _Arithmetic(do, kind)
    u, rest = a.total(a.constant(1.0), x)
    high, low = _logarithm_of(a, u)
    usual = _keeping_zero(a, x, a.add(high, a.add(low, a.divide(rest, u))))
    return _with_library(a, "log1p", a.within(LEAST_NORMAL, u, LARGEST_NUMBER), usual, x)


def _keeping_zero(a: _Arithmetic, x: Value, result: Value) -> Value:
    """The result, but zero with its sign for zero."""
    return a.select(a.do.do("feq", f"b{a.suffix}", x, a.constant(0.0)), x, result)


def power(do: Operations, kind: str, base: Value, exponent: Value) -> Value:
    """A power with a float as its exponent."""
    a = _Arithmetic(do, kind)
    high, low = _logarithm_of(a, base)
    product, rest = a.product(exponent, high)
    usual = _exponential_from(a, product, a.fused(exponent, low, rest))
    fits = do.do(
        "and",
        f"b{a.suffix}",
        a.within(LEAST_NORMAL, base, LARGEST_NUMBER),
        a.within(-LARGEST_EXPONENT, product, LARGEST_EXPONENT),
    )
    return _with_library(a, "pow", fits, usual, base, exponent)


ELEMENTARY: dict[str, Callable[..., Value]] = {
    "sin": _sine,
    "cos": _cosine,
    "exp": _exponential,
    "expm1": _expm1,
    "tanh": _tanh,
    "log": _logarithm,
    "log1p": _log1p,
}
"""Rules, as those of `.elementwise`, by the names of primitives."""
