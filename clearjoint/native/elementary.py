"""Elementary functions as arithmetic, so that vectors of lanes and tangents compute them at once.

The C library would be called for each lane and tangent. Here the same operations are computed at
any width, so that the bits of a result do not depend on it.

Sines and cosines: reduction by fused multiply-adds (Cody and Waite) and the polynomials of Sun's
fdlibm. Exponentials, logarithms, powers and hyperbolic tangents: sums of two doubles (Dekker) and
Taylor's polynomials of a reduced argument. Errors are below one unit in the last place, measured
with mpmath in the tests: at most 0.95 for `expm1`, 0.8 for sines, cosines and `tanh`, and 0.7 for
the others. The C library computes results for arguments outside the ranges below, infinities and
NaN.

A number of about twice the precision of a double is the sum of two: a high and a low part.
"""

import math
from collections.abc import Callable, Sequence

from .operations import Number, Operations, Value

LARGEST_ANGLE = 1e8
"""Largest argument of sines and cosines, rad."""
LARGEST_EXPONENT = 700.0
"""Largest argument of exponentials; of a power, exponent times logarithm of the base."""
LEAST_NORMAL, LARGEST_NUMBER = 2.2250738585072014e-308, 1.7976931348623157e308
"""Range of the arguments of logarithms and of the bases of powers."""
_LN_2 = (0.6931471805598903, 5.497923018708371e-14)
"""High and low part of log(2); integer multiples of the high part are exact."""
_TWO_THIRDS = (2.0 / 3.0, 3.700743415417188e-17)
"""High and low part of 2/3."""
_LOGARITHM = tuple(2.0 / k for k in range(5, 29, 2))
"""Coefficients of 2 artanh, from the fifth power on."""
_EXPONENTIAL = tuple(1.0 / math.factorial(k) for k in range(3, 15))
"""Coefficients of exp, from the third power on."""
_LAST_TANH = 22.0
"""Argument from which on tanh is one to rounding."""
_ROOT_OF_HALF = 0x3FE6A09E667F3BCD
"""Bits of the root of 1/2."""
_HALF_PI = (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591833e-33)
"""pi/2 as a sum of three doubles."""
_ROUNDING = 6755399441055744.0
"""1.5 * 2**52: the sum with a number below 2**51 has the nearest integer in its last bits."""
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
    """Emits arithmetic on floats or on vectors of tangents, according to `kind`.

    Methods append operations to `ops` and return the symbol of the result, not a number.
    """

    def __init__(self, ops: Operations, kind: str):
        self.ops, self.kind = ops, kind
        self.suffix = kind[1:]

    def constant(self, number: Number, kind: str = "f") -> Value:
        value = self.ops.constant(kind, number)
        return self.ops.emit("splat", kind + self.suffix, value) if self.suffix else value

    def add(self, a: Value, b: Value) -> Value:
        return self.ops.emit("fadd", self.kind, a, b)

    def subtract(self, a: Value, b: Value) -> Value:
        return self.ops.emit("fsub", self.kind, a, b)

    def multiply(self, a: Value, b: Value) -> Value:
        return self.ops.emit("fmul", self.kind, a, b)

    def fused(self, a: Value, b: Value, c: Value) -> Value:
        """Return a b + c, rounded once."""
        return self.ops.emit("fma", self.kind, a, b, c)

    def polynomial(self, x: Value, coefficients: Sequence[float]) -> Value:
        """Emit the evaluation of a polynomial at x, and return its value.

        Estrin's scheme joins neighbouring terms in pairs, then the pairs, and so on. Unlike
        Horner's, most of its operations don't wait for each other.

        **Arguments:** `coefficients`: by rising powers, at least one.
        """
        terms = [self.constant(coefficient) for coefficient in coefficients]
        while len(terms) > 1:
            rest = terms[len(terms) // 2 * 2 :]  # the last term of an odd number
            pairs = zip(terms[::2], terms[1::2], strict=False)
            terms = [self.fused(high, x, low) for low, high in pairs] + rest
            x = self.multiply(x, x)
        return terms[0]

    def negative(self, a: Value) -> Value:
        return self.ops.emit("fneg", self.kind, a)

    def divide(self, a: Value, b: Value) -> Value:
        return self.ops.emit("fdiv", self.kind, a, b)

    def product(self, a: Value, b: Value) -> tuple[Value, Value]:
        """Return the exact product a b as the sum of a high and a low part."""
        high = self.multiply(a, b)
        return high, self.fused(a, b, self.negative(high))

    def total(self, a: Value, b: Value) -> tuple[Value, Value]:
        """Return the exact sum a + b as the sum of a high and a low part (Knuth)."""
        high = self.add(a, b)
        moved = self.subtract(high, a)
        low = self.subtract(a, self.subtract(high, moved))
        return high, self.add(low, self.subtract(b, moved))

    def rounded(self, a: Value) -> tuple[Value, Value]:
        """Return the integer n nearest to a, as a float and as an integer whose last bits are n."""
        shifted = self.add(a, self.constant(_ROUNDING))
        return self.subtract(shifted, self.constant(_ROUNDING)), self.bits(shifted)

    def scaled(self, a: Value, n: Value) -> Value:
        """Return a 2**n for an integer n; both a and the result must be normal numbers."""
        shift = self.whole("shift_left", n, 52)
        return self.of_bits(self.ops.emit("add", f"i{self.suffix}", self.bits(a), shift))

    def whole(self, name: str, a: Value, number: int) -> Value:
        return self.ops.emit(name, f"i{self.suffix}", a, self.constant(number, "i"))

    def of_bits(self, whole: Value) -> Value:
        return self.ops.emit("float_of_bits", self.kind, whole)

    def within(self, least: float, value: Value, largest: float) -> Value:
        condition = f"b{self.suffix}"
        above = self.ops.emit("fge", condition, value, self.constant(least))
        return self.ops.emit(
            "and", condition, above, self.ops.emit("fle", condition, value, self.constant(largest))
        )

    def bits(self, value: Value) -> Value:
        return self.ops.emit("float_bits", f"i{self.suffix}", value)

    def has_bit(self, whole: Value, bit: int) -> Value:
        masked = self.ops.emit("and", f"i{self.suffix}", whole, self.constant(bit, "i"))
        return self.ops.emit("ine", f"b{self.suffix}", masked, self.constant(0, "i"))

    def select(self, condition: Value, yes: Value, no: Value) -> Value:
        return self.ops.emit("select", self.kind, condition, yes, no)


def _sine_and_cosine(ops: Operations, kind: str, angle: Value) -> tuple[Value, Value, Value]:
    """Return sine and cosine of angle - n pi/2 for the nearest integer n, and n.

    Angles are in rad. The third result is an integer whose last bits are n.
    """
    a = _Arithmetic(ops, kind)
    rounding = a.constant(_ROUNDING)
    shifted = a.fused(angle, a.constant(2.0 / math.pi), rounding)
    minus = ops.emit("fneg", kind, a.subtract(shifted, rounding))
    # x + tail = angle - n pi/2, with pi/2 as a sum of three doubles. The first difference is exact.
    # Near multiples of pi/2 it is as small as the second term, so the rounding error of their sum
    # is computed too (Knuth) and becomes part of the tail.
    first, second = a.fused(minus, a.constant(_HALF_PI[0]), angle), a.constant(_HALF_PI[1])
    product = a.multiply(minus, second)
    x = a.add(first, product)
    moved = a.subtract(x, first)
    tail = a.add(a.subtract(first, a.subtract(x, moved)), a.subtract(product, moved))
    tail = a.add(tail, a.fused(minus, second, ops.emit("fneg", kind, product)))
    tail = a.fused(minus, a.constant(_HALF_PI[2]), tail)
    # fdlibm's polynomials on [-pi/4, pi/4], with the tail to first order.
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
    """Replace the result by the C library's in lanes whose arguments are out of range.

    The library is called only if there is such a lane.
    """
    beyond = a.ops.emit("not", f"b{a.suffix}", fits)

    def rare() -> list[Value]:
        return [a.select(beyond, a.ops.emit(name, a.kind, *given), usual)]

    return a.ops.branch(beyond, rare, lambda: [usual])[0]


def _circular(name: str) -> Callable[..., Value]:
    """The rule for "sin" or "cos"."""

    def rule(ops: Operations, kind: str, parameters: object, angle: Value) -> Value:
        if ops.number(angle) is not None:
            return ops.constant("f", getattr(math, name)(float(ops.constants[angle])))
        a = _Arithmetic(ops, kind)
        sine, cosine, quarter = _sine_and_cosine(ops, kind, angle)
        even, odd = (sine, cosine) if name == "sin" else (cosine, sine)
        size = a.select(a.has_bit(quarter, 1), odd, even)
        if name == "cos":  # cos(x) = sin(x + pi/2)
            quarter = ops.emit("add", f"i{a.suffix}", quarter, a.constant(1, "i"))
        usual = a.select(a.has_bit(quarter, 2), ops.emit("fneg", kind, size), size)
        fits = a.within(-LARGEST_ANGLE, angle, LARGEST_ANGLE)
        return _with_library(a, name, fits, usual, angle)

    return rule


def _logarithm_of(a: _Arithmetic, x: Value) -> tuple[Value, Value]:
    """Return high and low part of the logarithm of a positive normal number."""
    # x = m 2**k with m between the roots of 1/2 and 2, and log m = 2 artanh(s) with
    # s = (m - 1) / (m + 1) = f / divisor, as s + s_low.
    bits = a.bits(x)
    above = a.whole("sub", bits, _ROOT_OF_HALF)
    k = a.whole("shift_right", above, 52)
    m = a.of_bits(a.ops.emit("sub", f"i{a.suffix}", bits, a.whole("shift_left", k, 52)))
    rounding = a.constant(_ROUNDING)
    number = a.subtract(a.of_bits(a.ops.emit("add", f"i{a.suffix}", k, a.bits(rounding))), rounding)
    one = a.constant(1.0)
    f, (divisor, rest) = a.subtract(m, one), a.total(m, one)
    inverse = a.divide(one, divisor)
    s = a.multiply(f, inverse)
    s_low = a.fused(a.negative(s), divisor, f)
    s_low = a.multiply(a.fused(a.negative(s), rest, s_low), inverse)
    # 2 artanh(s) = 2 s + s (2/3 s**2 + ...): the sum in parentheses is w + w_low.
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
    # log x = k log(2) + log m. The first product is exact.
    first = a.multiply(number, a.constant(_LN_2[0]))
    result = a.add(first, high)
    low = a.fused(number, a.constant(_LN_2[1]), low)
    return result, a.add(a.add(a.subtract(first, result), high), low)


def _exponential_of(
    a: _Arithmetic, x: Value, x_low: Value
) -> tuple[Value, Value, tuple[Value, Value]]:
    """Return r, p and n of exp(x + x_low) = 2**n (1 + r + p), n as a float and as an integer."""
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
    """Return high and low part of exp(x) - 1."""
    r, p, (_, n) = _exponential_of(a, x, a.constant(0.0))
    one = a.constant(1.0)
    scale = a.scaled(one, n)
    high, low = a.total(scale, a.negative(one))
    high, lower = a.total(high, a.multiply(scale, r))
    return a.total(high, a.add(a.add(low, lower), a.multiply(scale, p)))


def _exponential(ops: Operations, kind: str, parameters: object, x: Value) -> Value:
    a = _Arithmetic(ops, kind)
    usual = _exponential_from(a, x, a.constant(0.0))
    return _with_library(a, "exp", a.within(-LARGEST_EXPONENT, x, LARGEST_EXPONENT), usual, x)


def _expm1(ops: Operations, kind: str, parameters: object, x: Value) -> Value:
    a = _Arithmetic(ops, kind)
    usual = _keeping_zero(a, x, _exponential_less_one(a, x)[0])
    return _with_library(a, "expm1", a.within(-LARGEST_EXPONENT, x, LARGEST_EXPONENT), usual, x)


def _tanh(ops: Operations, kind: str, parameters: object, x: Value) -> Value:
    """E / (E + 2) with E = exp(2 |x|) - 1, and the sign of x."""
    a = _Arithmetic(ops, kind)
    size, last = ops.emit("abs", kind, x), a.constant(_LAST_TANH)
    size = a.select(ops.emit("fgt", f"b{a.suffix}", size, last), last, size)
    high, low = _exponential_less_one(a, a.add(size, size))
    divisor, rest = a.total(a.constant(2.0), high)
    q = a.divide(high, divisor)
    left = a.add(a.fused(a.negative(q), divisor, high), low)
    left = a.fused(a.negative(q), a.add(rest, low), left)
    return ops.emit("copysign", kind, a.add(q, a.divide(left, divisor)), x)


def _logarithm(ops: Operations, kind: str, parameters: object, x: Value) -> Value:
    a = _Arithmetic(ops, kind)
    fits = a.within(LEAST_NORMAL, x, LARGEST_NUMBER)
    return _with_library(a, "log", fits, a.add(*_logarithm_of(a, x)), x)


def _log1p(ops: Operations, kind: str, parameters: object, x: Value) -> Value:
    a = _Arithmetic(ops, kind)
    u, rest = a.total(a.constant(1.0), x)
    high, low = _logarithm_of(a, u)
    usual = _keeping_zero(a, x, a.add(high, a.add(low, a.divide(rest, u))))
    return _with_library(a, "log1p", a.within(LEAST_NORMAL, u, LARGEST_NUMBER), usual, x)


def _keeping_zero(a: _Arithmetic, x: Value, result: Value) -> Value:
    """Return the result, or x itself where x is a zero, which has a sign."""
    return a.select(a.ops.emit("feq", f"b{a.suffix}", x, a.constant(0.0)), x, result)


def power(ops: Operations, kind: str, base: Value, exponent: Value) -> Value:
    """Compute a power with a float as exponent."""
    a = _Arithmetic(ops, kind)
    high, low = _logarithm_of(a, base)
    product, rest = a.product(exponent, high)
    usual = _exponential_from(a, product, a.fused(exponent, low, rest))
    fits = ops.emit(
        "and",
        f"b{a.suffix}",
        a.within(LEAST_NORMAL, base, LARGEST_NUMBER),
        a.within(-LARGEST_EXPONENT, product, LARGEST_EXPONENT),
    )
    return _with_library(a, "pow", fits, usual, base, exponent)


ELEMENTARY: dict[str, Callable[..., Value]] = {
    "sin": _circular("sin"),
    "cos": _circular("cos"),
    "exp": _exponential,
    "expm1": _expm1,
    "tanh": _tanh,
    "log": _logarithm,
    "log1p": _log1p,
}
"""Rules as in `.elementwise`, by the names of primitives."""
