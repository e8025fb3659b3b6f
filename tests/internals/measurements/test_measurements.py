"""Factors from units to SI units."""

import math

import pytest

from clearjoint._measurements.series import to_si


@pytest.mark.parametrize(
    ("unit", "si", "factor"),
    [
        ("mm", "m", 1e-3),
        ("deg", "rad", math.pi / 180),
        ("rpm", "rad/s", math.pi / 30),
        ("g_0", "m/s^2", 9.80665),
        ("lbf", "N", 4.4482216152605),
        ("1", "1", 1.0),
        ("%", "1", 0.01),
        ("N cm", "N m", 0.01),
    ],
)
def test_units_become_si(unit, si, factor):
    found, name = to_si(unit, si)
    assert (found, name) == (pytest.approx(factor, rel=1e-14), si)


def test_units_of_user_defined_functions_become_si_units():
    assert to_si("N", None) == (1.0, "N")
    assert to_si("mN", None) == (pytest.approx(1e-3), "kg*m/s**2")
    assert to_si("%", None) == (pytest.approx(0.01), "1")


@pytest.mark.parametrize(
    ("unit", "si", "message"),
    [
        ("kg", "m", "Argument `unit` must be a unit of 'm', but is 'kg'"),
        ("g", "m/s^2", r"a unit of 'm/s\^2', but is 'g': .* gram has dimension \[mass\]"),
        ("Hz", "rad/s", "not cycles, but is 'Hz': write \"rpm\""),
        ("degC", None, "a multiple of kelvin, but is 'degC'"),
        ("dB", "1", "a multiple of dimensionless, but is 'dB'"),
        ("m/s2", "m/s^2", "a unit that pint knows, but is 'm/s2': write for example"),
        ("(", "m", r"a unit that pint knows, but is '\('"),
        ("m", "metr", "Argument `si` must be a unit that pint knows, but is 'metr'"),
    ],
)
def test_units_without_a_factor_are_refused(unit, si, message):
    with pytest.raises(ValueError, match=message):
        to_si(unit, si)
