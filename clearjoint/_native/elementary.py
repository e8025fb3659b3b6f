"""Elementary functions as arithmetic operations, which apply to scalars and to vectors alike.

Functions of the C library would be called for each element of a vector. The operations are the
same for vectors of any length, so that the bits of a result do not depend on the length.

- Sines and cosines: the angle is reduced with fused multiply-adds (Cody and Waite), and evaluated
  by the polynomials of Sun's fdlibm.
- Arc tangents: fdlibm's polynomial of a reduced quotient.
- Exponentials, logarithms, powers and `tanh`: Taylor polynomials of a reduced argument, with sums
  of two doubles, a high and a low part (Dekker).

The errors, measured with mpmath in the tests, are at most 0.95 units in the last place for `expm1`,
0.8 for sines, cosines and `tanh`, and 0.7 for the others. For infinities, NaN and arguments outside
of the ranges given below, all of these functions but `tanh` call the C library.
"""

import math
from collections.abc import Callable, Sequence

from .operations import Symbol

LARGEST_ANGLE = 1e8
"""Largest absolute angle, rad, of sines and cosines: the reduction of others would lose digits."""
LARGEST_EXPONENT = 700.0
"""Largest absolute value of x in exp(x), and of exponent log(base) in powers. The results, from
1e-304 to 1e304, are normal numbers."""
LEAST_NORMAL, LARGEST_NUMBER = 2.2250738585072014e-308, 1.7976931348623157e308
"""Range of the arguments of logarithms, of 1 + x for `log1p`, and of the bases of powers."""
_LN_2 = (0.6931471805598903, 5.497923018708371e-14)
"""High and low part of log(2). The high part ends in zero bits, so that its product with the
exponent of a double is exact."""
_TWO_THIRDS = (2.0 / 3.0, 3.700743415417188e-17)
"""High and low part of 2/3."""
_LOGARITHM = tuple(2.0 / k for k in range(5, 29, 2))
"""Taylor coefficients of 2 artanh, from the fifth power on."""
_EXPONENTIAL = tuple(1.0 / math.factorial(k) for k in range(3, 15))
"""Taylor coefficients of exp, from the third power on."""
_LAST_TANH = 22.0
"""Argument from which on tanh rounds to one."""
_ROOT_OF_HALF = 0x3FE6A09E667F3BCD
"""Bits of the square root of 1/2, as an integer: the lower bound of m where a logarithm writes its
argument as m 2**k."""
_HALF_PI = (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591833e-33)
"""pi/2 as a sum of three doubles."""
_QUARTER_PI = (0.7853981633974483, 3.061616997868383e-17)
"""pi/4 as a sum of two doubles."""
_TANGENT_OF_EIGHTH = 0.41421356237309503
"""tan(pi/8)."""
LEAST_QUOTIENT, LARGEST_QUOTIENT = 1e-290, 1e290
"""Range of |y| and |x| in arc tangents of y/x, in which the remainder of the division is a normal
number. One of the two may also be zero."""
_ROUNDING = 6755399441055744.0
"""1.5 * 2**52. Added to a number of absolute value below 2**51, it gives a sum whose last bits are
those of the nearest integer."""
# Coefficients of fdlibm's polynomials: for sines from the third power on, for cosines from the
# fourth power on.
_SINE = (
    -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
    2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10,
)  # fmt: skip
_COSINE = (
    4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
    -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11,
)  # fmt: skip

# For arc tangents up to 7/16, from the third power on, with alternating signs as 1/3, 1/5, ...
_ARC_TANGENT = (
    3.33333333333329318027e-01, -1.99999999998764832476e-01, 1.42857142725034663711e-01,
    -1.11111104054623557880e-01, 9.09088713343650656196e-02, -7.69187620504482999495e-02,
    6.66107313738753120669e-02, -5.83357013379057348645e-02, 4.97687799461593236017e-02,
    -3.65315727442169155270e-02, 1.62858201153657823623e-02,
)  # fmt: skip


def _fma(a: Symbol, b: Symbol | float, c: Symbol | float) -> Symbol:
    return a.emit("fma", b, c)


def _polynomial(x: Symbol, coefficients: Sequence[float]) -> Symbol:
    """Return the polynomial with the given coefficients, the constant first, at x by Estrin's
    scheme, in which most operations do not depend on each other."""
    terms = [x.like(coefficient) for coefficient in coefficients]
    while len(terms) > 1:
        # Each pair of coefficients, low + high x, is one coefficient of a polynomial in x^2.
        unpaired = terms[len(terms) // 2 * 2 :]  # the last term of an odd number
        pairs = zip(terms[::2], terms[1::2], strict=False)
        terms = [_fma(high, x, low) for low, high in pairs] + unpaired
        x = x * x
    return terms[0]


def _product(a: Symbol, b: Symbol | float) -> tuple[Symbol, Symbol]:
    """Return the exact product a b as the sum of its rounded value and the rounding error."""
    high = a * b
    return high, _fma(a, b, -high)


def _sum(a: Symbol, b: Symbol) -> tuple[Symbol, Symbol]:
    """Return the exact sum a + b as the sum of its rounded value and the rounding error (Knuth)."""
    high = a + b
    b_in_high = high - a
    low = a - (high - b_in_high)
    return high, low + (b - b_in_high)


def _bits(a: Symbol) -> Symbol:
    return a.emit("float_bits", letter="i")


def _of_bits(bits: Symbol) -> Symbol:
    return bits.emit("float_of_bits", letter="f")


def _scaled(a: Symbol, n: Symbol) -> Symbol:
    """Return a * 2**n, for a normal `a` and a normal result. Only the last 12 bits of n count."""
    # The exponent of a double begins at bit 52.
    return _of_bits(_bits(a) + n.emit("shift_left", 52))


def _within(least: float, a: Symbol, largest: float) -> Symbol:
    return a.compare("ge", least) & a.compare("le", largest)


def _has_bit(a: Symbol, bit: int) -> Symbol:
    return (a & bit).compare("ne", 0)


def _sine_and_cosine(angle: Symbol) -> tuple[Symbol, Symbol, Symbol]:
    """Return sine and cosine of angle - n pi/2, with n nearest to angle / (pi/2), and an integer
    with the same last two bits as n, which determine the quadrant."""
    # `shifted` has n in its last bits, and `minus` is -n as a float.
    shifted = _fma(angle, 2.0 / math.pi, _ROUNDING)
    minus = -(shifted - _ROUNDING)
    # x + tail = angle - n pi/2, with pi/2 as a sum of three doubles. The first difference is exact.
    # Near multiples of pi/2 it is as small as the second term, so the rounding error of their sum
    # is computed too (Knuth) and becomes part of the tail.
    first, second = _fma(minus, _HALF_PI[0], angle), minus * _HALF_PI[1]
    x = first + second
    second_in_x = x - first
    tail = (first - (x - second_in_x)) + (second - second_in_x)
    tail = tail + _fma(minus, _HALF_PI[1], -second)
    tail = _fma(minus, _HALF_PI[2], tail)
    # fdlibm's polynomials on [-pi/4, pi/4], with the tail to first order:
    # sin(x + tail) = x - x^3/6 + ... + tail (1 - z/2), and
    # cos(x + tail) = 1 - z/2 + z r - x tail, where z = x^2, `head` is the rounded 1 - z/2, and
    # `rest` the sum of its rounding error and the other terms.
    z, half, one = x * x, x.like(0.5), x.like(1.0)
    cube = z * x
    inner = half * tail - cube * _polynomial(z, _SINE[1:])
    inner = z * inner - tail
    sine = x - (inner - cube * _SINE[0])
    half_square = half * z
    head = one - half_square
    rest = (one - head) - half_square
    r = z * _polynomial(z, _COSINE)
    rest = rest + (z * r - x * tail)
    return sine, head + rest, _bits(shifted)


def _with_library(name: str, fits: Symbol, usual: Symbol, *arguments: Symbol) -> Symbol:
    """Return `usual` where `fits` holds, else the result of the C function `name` of the arguments,
    which a program calls only if `fits` is false in some lane."""
    ops, beyond = usual.ops, ~fits
    argument, *further_arguments = arguments

    # Lanes in which `fits` holds keep `usual`, so that their results do not depend on other lanes.
    def by_library() -> list[int]:
        return [beyond.select(argument.emit(name, *further_arguments), usual).value]

    def result() -> int:
        return ops.branch(beyond.value, by_library, lambda: [usual.value])[0]

    # The same function of the same arguments is computed once, as a pure operation is.
    return Symbol(ops, ops.once((name, *(x.value for x in arguments)), result))


def _sine(angle: Symbol, name: str = "sin") -> Symbol:
    # The sine of an angle that is known already needs no operation in the program.
    number = angle.ops.number(angle.value)
    if number is not None:
        # Python refuses infinite angles.
        return angle.like(getattr(math, name)(float(number)) if math.isfinite(number) else math.nan)
    sine, cosine, quarter = _sine_and_cosine(angle)
    # sin(x + n pi/2) is sin(x), cos(x), -sin(x) and -cos(x) for n = 0 to 3, the last two bits of n,
    # in which `quarter` ends.
    even, odd = (sine, cosine) if name == "sin" else (cosine, sine)
    size = _has_bit(quarter, 1).select(odd, even)
    if name == "cos":  # The sign follows from cos(x + n pi/2) = sin(x + (n + 1) pi/2).
        quarter = quarter + 1
    usual = _has_bit(quarter, 2).select(-size, size)
    return _with_library(name, _within(-LARGEST_ANGLE, angle, LARGEST_ANGLE), usual, angle)


def _logarithm_of(x: Symbol) -> tuple[Symbol, Symbol]:
    """Return the logarithm of a positive normal number as a high and a low part."""
    # x = m 2**k with m between the square roots of 1/2 and 2, and log m = 2 artanh(s + s_low) with
    # s + s_low = (m - 1) / (m + 1) = f / (divisor + rest), where f = m - 1 is exact.
    # k is found from the bits of x, in which the exponent begins at bit 52. The bits of `_ROUNDING`
    # plus k are those of the float `_ROUNDING` + k, from which `k_float` follows.
    bits = _bits(x)
    k = (bits - _ROOT_OF_HALF).emit("shift_right", 52)
    m = _of_bits(bits - k.emit("shift_left", 52))
    k_float = _of_bits(k + _bits(x.like(_ROUNDING))) - _ROUNDING
    one = x.like(1.0)
    f, (divisor, rest) = m - one, _sum(m, one)
    inverse = one / divisor
    s = f * inverse
    s_low = _fma(-s, divisor, f)
    s_low = _fma(-s, rest, s_low) * inverse
    # 2 artanh(s) = 2 s + s (2/3 s**2 + ...): the sum in parentheses is w + w_low.
    square, square_low = _product(s, s)
    square_low = _fma(s + s, s_low, square_low)
    third, third_low = _product(square, _TWO_THIRDS[0])
    third_low = _fma(square, _TWO_THIRDS[1], third_low)
    third_low = _fma(square_low, _TWO_THIRDS[0], third_low)
    tail = (square * square) * _polynomial(square, _LOGARITHM)
    w = third + tail
    w_low = ((third - w) + tail) + third_low
    cubic, cubic_low = _product(s, w)
    cubic_low = _fma(s_low, w, _fma(s, w_low, cubic_low))
    twice, twice_low = s + s, s_low + s_low
    high = twice + cubic
    low = (((twice - high) + cubic) + cubic_low) + twice_low
    # log x = k log(2) + log m. The product of k and the high part of log(2) is exact.
    k_log_2 = k_float * _LN_2[0]
    result = k_log_2 + high
    low = _fma(k_float, _LN_2[1], low)
    return result, ((k_log_2 - result) + high) + low


def _exponential_of(x: Symbol, x_low: Symbol | float) -> tuple[Symbol, Symbol, Symbol]:
    """Return r, p and an integer with the last bits of n, where exp(x + x_low) = 2**n (1 + r + p).
    `x_low` is the low part of the argument, and n is the integer nearest to x/log(2). r is x +
    x_low - n log(2), rounded, and p is exp(r) - 1 - r plus the rounding error of r."""
    # `shifted` has n in its last bits, and `minus` is -n as a float.
    shifted = x * (1.0 / math.log(2.0)) + _ROUNDING
    minus = -(shifted - _ROUNDING)
    r, r_low = _sum(_fma(minus, _LN_2[0], x), _fma(minus, _LN_2[1], x_low))
    # exp(r) - 1 - r = r^2 (1/2 + r (1/6 + ...)), and r_low enters to first order.
    cube = r * _polynomial(r, _EXPONENTIAL)
    return r, _fma(r * r, r.like(0.5) + cube, r_low), _bits(shifted)


def _exponential_from(x: Symbol, x_low: Symbol | float) -> Symbol:
    """Return exp(x + x_low)."""
    r, p, n = _exponential_of(x, x_low)
    one = r.like(1.0)
    y = one + r
    return _scaled(y + ((r - (y - one)) + p), n)


def _exponential_less_one(x: Symbol) -> tuple[Symbol, Symbol]:
    """Return exp(x) - 1 as a high and a low part."""
    # exp(x) - 1 = (2**n - 1) + 2**n r + 2**n p. The first two terms may nearly cancel, so their
    # rounding errors are kept.
    r, p, n = _exponential_of(x, 0.0)
    one = x.like(1.0)
    scale = _scaled(one, n)
    high, low = _sum(scale, -one)
    high, lower = _sum(high, scale * r)
    return _sum(high, (low + lower) + scale * p)


def _exponential(x: Symbol) -> Symbol:
    fits = _within(-LARGEST_EXPONENT, x, LARGEST_EXPONENT)
    return _with_library("exp", fits, _exponential_from(x, 0.0), x)


def _expm1(x: Symbol) -> Symbol:
    usual = _keeping_zero(x, _exponential_less_one(x)[0])
    return _with_library("expm1", _within(-LARGEST_EXPONENT, x, LARGEST_EXPONENT), usual, x)


def _tanh(x: Symbol) -> Symbol:
    """Return tanh(x) as E / (E + 2), where E = exp(2 |x|) - 1, with the sign of x."""
    # Beyond `_LAST_TANH` the result is one, and E would overflow.
    size, last = x.emit("abs"), x.like(_LAST_TANH)
    size = size.compare("gt", last).select(last, size)
    high, low = _exponential_less_one(size + size)
    divisor, rest = _sum(x.like(2.0), high)
    # The remainder of the division corrects the quotient.
    q = high / divisor
    remainder = _fma(-q, divisor, high) + low
    remainder = _fma(-q, rest + low, remainder)
    return (q + remainder / divisor).emit("copysign", x)


def _logarithm(x: Symbol) -> Symbol:
    high, low = _logarithm_of(x)
    return _with_library("log", _within(LEAST_NORMAL, x, LARGEST_NUMBER), high + low, x)


def _log1p(x: Symbol) -> Symbol:
    """Return log(1 + x) as log(u) + rest/u, where u is 1 + x rounded and `rest` its error."""
    u, rest = _sum(x.like(1.0), x)
    high, low = _logarithm_of(u)
    usual = _keeping_zero(x, high + (low + rest / u))
    return _with_library("log1p", _within(LEAST_NORMAL, u, LARGEST_NUMBER), usual, x)


def _keeping_zero(x: Symbol, result: Symbol) -> Symbol:
    return x.compare("eq", 0.0).select(x, result)


def power(base: Symbol, exponent: Symbol) -> Symbol:
    """Return exp(exponent log(base)), with twice the usual precision inside of the exponential."""
    high, low = _logarithm_of(base)
    product, rest = _product(exponent, high)
    usual = _exponential_from(product, _fma(exponent, low, rest))
    fits = _within(LEAST_NORMAL, base, LARGEST_NUMBER) & _within(
        -LARGEST_EXPONENT, product, LARGEST_EXPONENT
    )
    return _with_library("pow", fits, usual, base, exponent)


def _arc_tangent(y: Symbol, x: Symbol) -> Symbol:
    """Return the angle of the point (x, y) with the x axis, -pi to pi rad."""
    across, along = y.emit("abs"), x.emit("abs")
    steep = across.compare("gt", along)
    small, large = steep.select(along, across), steep.select(across, along)
    # The angle of the point (large, small), at most pi/4, is arctan(top / divisor) with top = small
    # and divisor = large. Above pi/8 it is pi/4 + arctan(top / divisor), with top = small - large
    # and divisor = large + small. Both are sums of two doubles, and so is the quotient, q + q_low.
    zero = y.like(0.0)
    above = small.compare("gt", large * _TANGENT_OF_EIGHTH)
    top, top_low = _sum(small, above.select(-large, zero))
    divisor, divisor_low = _sum(large, above.select(small, zero))
    q = top / divisor
    remainder = _fma(-q, divisor_low, _fma(-q, divisor, top) + top_low)
    q_low = remainder / divisor
    # arctan(q + q_low) = q - q z P(z) + q_low (1 - z + ...), where z = q^2.
    z = q * q
    low = _fma(q_low, y.like(1.0) - z, -(q * (z * _polynomial(z, _ARC_TANGENT))))
    # The size of the result is a multiple of pi/4, `quarters`, plus or minus this arctangent. A
    # steep direction is measured from pi/2 downwards, and one to the left from pi downwards.
    left_side = x.compare("lt", 0.0)
    quarters = above.select(y.like(1.0), zero)
    quarters = steep.select(y.like(2.0) - quarters, quarters)
    quarters = left_side.select(y.like(4.0) - quarters, quarters)
    downwards = steep ^ left_side
    signed_q, signed_low = downwards.select(-q, q), downwards.select(-low, low)
    multiple, multiple_low = _product(quarters, _QUARTER_PI[0])
    high, rest = _sum(multiple, signed_q)
    usual = high + (rest + (signed_low + _fma(quarters, _QUARTER_PI[1], multiple_low)))
    # Outside of these ranges, the remainder may be no normal number: the C library is called.
    fits = large.compare("le", LARGEST_QUOTIENT) & (
        small.compare("ge", LEAST_QUOTIENT)
        | (small.compare("eq", 0.0) & large.compare("ge", LEAST_QUOTIENT))
    )
    return _with_library("atan2", fits, usual.emit("copysign", y), y, x)


ELEMENTARY: dict[str, Callable[..., Symbol]] = {
    "sin": _sine,
    "cos": lambda angle: _sine(angle, "cos"),
    "exp": _exponential,
    "expm1": _expm1,
    "tanh": _tanh,
    "log": _logarithm,
    "log1p": _log1p,
    "atan": lambda slope: _arc_tangent(slope, slope.like(1.0)),
    "atan2": _arc_tangent,
}
"""Functions that add a primitive's operations to the program, by the names of the primitives."""
