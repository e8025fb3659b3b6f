"""Masses and principal moments of homogeneous solids, by their measures and a mass or a density."""

import math
from typing import NamedTuple

from jaxtyping import PyTree

from ..fields.checks import (
    as_number,
    as_shown,
    caution_outside,
    checkable,
    require,
    require_positive,
    require_shape,
)
from ..fields.conversion import as_numbers
from ..fields.types import ArrayLike
from .densities import STEEL

AXES = ("x", "y", "z")
METRES = "give it in m"
LIGHTEST, HEAVIEST = 10.0, 25e3
"""Densities that solids have, kg/m^3: from foams to platinum."""
Measure = PyTree
"""A number as it is given, or one that JAX traces."""


class Solid(NamedTuple):
    """Mass, kg, and principal moments about the centre of mass, (3,) kg m^2."""

    mass: ArrayLike
    moments: PyTree


def require_one(mass: Measure, density: Measure) -> None:
    """Check that one of a mass and a density is given."""
    given = {"mass": mass, "density": density}
    named = [name for name, value in given.items() if value is not None]
    remedy = "pass mass= in kg, or density= in kg/m^3, such as clearjoint.densities.STEEL"
    require(len(named) == 1, "mass", named or None, "given, or a density in its place", remedy)


def slender_rod(length: Measure, mass: Measure, axis: str) -> Solid:
    """A rod that is known by its mass alone: moments m l^2/12 across its axis, and about it that of
    a round steel bar, which may not be thicker than long."""
    length, mass = _measure("length", length), _number("mass", mass, "give it in kg")
    squared_diameter = 4.0 * mass / (math.pi * STEEL * length)
    if (known := checkable(squared_diameter, length)) is not None:
        thin = known[0] <= known[1] ** 2
        remedy = "give its diameter in m, or check mass (kg) and length (m)"
        require(thin, "mass", mass, "that of a rod longer than thick", remedy)
    return _along(axis, mass, mass * squared_diameter / 8.0, mass * length**2 / 12.0)


def cylinder(
    diameter: Measure,
    length: Measure,
    mass: Measure,
    density: Measure,
    inner_diameter: Measure,
    axis: str,
) -> Solid:
    """A cylinder, or a tube: m (D^2 + d^2)/8 about its axis, and across it m (D^2 + d^2)/16 +
    m l^2/12."""
    diameter, length = _measure("diameter", diameter), _measure("length", length)
    inner = _inner(inner_diameter, diameter)
    mass = _mass(mass, density, 0.25 * math.pi * (diameter**2 - inner**2) * length)
    squares = diameter**2 + inner**2
    across = mass * (squares / 16.0 + length**2 / 12.0)
    return _along(axis, mass, mass * squares / 8.0, across)


def box(lengths: Measure, mass: Measure, density: Measure) -> Solid:
    """A box with sides along x, y and z: m (b^2 + c^2)/12 about the first, and so on."""
    lengths = as_number(lengths)
    require_shape("lengths", lengths, (3,), "pass three lengths in m, along x, y and z")
    sides = [_measure(f"lengths[{k}]", lengths[k]) for k in range(3)]
    mass = _mass(mass, density, sides[0] * sides[1] * sides[2])
    a, b, c = (side**2 for side in sides)
    return Solid(mass, as_numbers([mass * pair / 12.0 for pair in (b + c, c + a, a + b)]))


def sphere(diameter: Measure, mass: Measure, density: Measure, inner_diameter: Measure) -> Solid:
    """A sphere, or a hollow one: m (D^5 - d^5)/(10 (D^3 - d^3)) about every axis."""
    diameter = _measure("diameter", diameter)
    inner = _inner(inner_diameter, diameter)
    cubes = diameter**3 - inner**3
    mass = _mass(mass, density, math.pi * cubes / 6.0)
    return Solid(mass, as_numbers([mass * (diameter**5 - inner**5) / (10.0 * cubes)] * 3))


def _along(axis: str, mass: Measure, about: Measure, across: Measure) -> Solid:
    """A solid of revolution about one of the body's axes."""
    require(axis in AXES, "axis", axis, f"one of {AXES}", "name one of them")
    return Solid(mass, as_numbers([about if axis == name else across for name in AXES]))


def _mass(mass: Measure, density: Measure, volume: Measure) -> Measure:
    """The mass, kg, that is given or that a volume, m^3, of the density has."""
    require_one(mass, density)
    if mass is not None:
        return _number("mass", mass, "give it in kg")
    density = _number("density", density, "give it in kg/m^3")
    remedy = "give it in kg/m^3; clearjoint.densities has some"
    caution_outside("density", density, "kg/m^3", LIGHTEST, HEAVIEST, remedy)
    return density * volume


def _inner(inner_diameter: Measure, diameter: Measure) -> Measure:
    inner = as_number(inner_diameter)
    require_positive("inner_diameter", inner, METRES, zero=True)
    if (known := checkable(inner, diameter)) is not None:
        expected = f"less than the diameter, {as_shown(known[1])} m"
        require(known[0] < known[1], "inner_diameter", known[0], expected, METRES)
    return inner


def _measure(argument: str, value: Measure) -> Measure:
    return _number(argument, value, METRES)


def _number(argument: str, value: Measure, remedy: str) -> Measure:
    number = as_number(value)
    require_positive(argument, number, remedy)
    return number
