"""Mass and principal moments of inertia of homogeneous solids.

The functions compute them from the dimensions and either a mass or a density, for the methods
`rod`, `cylinder`, `box` and `sphere` of `Body`. They check the arguments and raise a `ValueError`
that names the invalid one.
"""

import math

from jaxtyping import PyTree

from ..fields.checks import (
    as_number,
    caution_outside,
    require,
    require_numbers,
    require_positive,
    require_shape,
)
from ..fields.conversion import as_numbers
from ..fields.types import ArrayLike
from .densities import STEEL

AXES = ("x", "y", "z")
METRES = "give it in m"
LIGHTEST, HEAVIEST = 10.0, 25e3
"""Range of the density of solids, kg/m^3, from foams to platinum, outside which a warning is
issued."""
Number = PyTree
"""A number that a user passes, which JAX may trace; ``None`` if it is not given."""


Solid = tuple[ArrayLike, PyTree]
"""Mass, kg, and principal moments about axes along x, y and z through the centre of mass, (3,)
kg m^2."""


def require_one(mass: Number, density: Number) -> None:
    """Check that exactly one of mass and density is not ``None``."""
    given = {"mass": mass, "density": density}
    named = [name for name, value in given.items() if value is not None]
    remedy = "pass mass= in kg, or density= in kg/m^3, such as clearjoint.densities.STEEL"
    require(len(named) == 1, "mass", named or None, "given, or else a density", remedy)


def slender_rod(length: Number, mass: Number, axis: str) -> Solid:
    """Return mass and moments of a thin rod from its length, m, and mass, kg.

    The moments across the axis are m l^2/12. A thin rod has no moment about its axis, but a body
    needs one: it is m d^2/8 with the diameter d of a round steel bar of this mass and length.
    `axis` is "x", "y" or "z".

    **Raises:** `ValueError` if the steel bar would be thicker than long.
    """
    length, mass = _length("length", length), _number("mass", mass, "give it in kg")
    # A round bar has the mass rho pi/4 d^2 l.
    squared_diameter = 4.0 * mass / (math.pi * STEEL * length)
    fits, values = (lambda _, d, l: d <= l**2), (mass, squared_diameter, length)
    remedy = "give its diameter in m, or check mass (kg) and length (m)"
    require_numbers(fits, "mass", values, "that of a rod longer than thick", remedy)
    return _along(axis, mass, mass * squared_diameter / 8.0, mass * length**2 / 12.0)


def cylinder(
    diameter: Number,
    length: Number,
    mass: Number,
    density: Number,
    inner_diameter: Number,
    axis: str,
) -> Solid:
    """Return mass and moments of a cylinder or tube from its dimensions, m.

    The moments are m (D^2 + d^2)/8 about the axis and m (D^2 + d^2)/16 + m l^2/12 across it, with
    the outer and inner diameters D and d. Either the mass, kg, or the density, kg/m^3, is ``None``.
    `axis` is "x", "y" or "z".
    """
    diameter, length = _length("diameter", diameter), _length("length", length)
    inner = _inner(inner_diameter, diameter)
    mass = _mass(mass, density, 0.25 * math.pi * (diameter**2 - inner**2) * length)
    squares = diameter**2 + inner**2
    across = mass * (squares / 16.0 + length**2 / 12.0)
    return _along(axis, mass, mass * squares / 8.0, across)


def box(lengths: Number, mass: Number, density: Number) -> Solid:
    """Return mass and moments of a box from its `lengths` along x, y and z, (3,) m.

    The moment about x is m (b^2 + c^2)/12 for the lengths b and c along y and z. Either the mass,
    kg, or the density, kg/m^3, is ``None``.
    """
    lengths = as_number(lengths)
    require_shape("lengths", lengths, (3,), "pass three lengths in m, along x, y and z")
    sides = [_length(f"lengths[{k}]", lengths[k]) for k in range(3)]
    mass = _mass(mass, density, sides[0] * sides[1] * sides[2])
    a, b, c = (side**2 for side in sides)
    return mass, as_numbers([mass * pair / 12.0 for pair in (b + c, c + a, a + b)])


def sphere(diameter: Number, mass: Number, density: Number, inner_diameter: Number) -> Solid:
    """Return mass and moments of a solid or hollow sphere from its diameters, m.

    The moment about every axis is m (D^5 - d^5)/(10 (D^3 - d^3)), with the outer and inner
    diameters D and d. Either the mass, kg, or the density, kg/m^3, is ``None``.
    """
    diameter = _length("diameter", diameter)
    inner = _inner(inner_diameter, diameter)
    cubes = diameter**3 - inner**3
    mass = _mass(mass, density, math.pi * cubes / 6.0)
    return mass, as_numbers([mass * (diameter**5 - inner**5) / (10.0 * cubes)] * 3)


def _along(axis: str, mass: Number, about: Number, across: Number) -> Solid:
    """Return the solid of revolution about an axis "x", "y" or "z".

    **Arguments:** `mass`: kg; `about`: moment about this axis; `across`: moment about each of the
    other two, kg m^2.
    """
    require(axis in AXES, "axis", axis, f"one of {AXES}", "pass one of these")
    return mass, as_numbers([about if axis == name else across for name in AXES])


def _mass(mass: Number, density: Number, volume: Number) -> Number:
    """Return the mass, kg, if it is given, otherwise the density, kg/m^3, times the volume, m^3.

    An unusual density gives a warning.
    """
    require_one(mass, density)
    if mass is not None:
        return _number("mass", mass, "give it in kg")
    density = _number("density", density, "give it in kg/m^3")
    remedy = "give it in kg/m^3; clearjoint.densities has some"
    caution_outside("density", density, "kg/m^3", LIGHTEST, HEAVIEST, remedy)
    return density * volume


def _inner(inner_diameter: Number, diameter: Number) -> Number:
    """Return the diameter of a hole, m, zero for none, after a check against the outer diameter."""
    inner = as_number(inner_diameter)
    require_positive("inner_diameter", inner, METRES, zero=True)
    expected = "less than the diameter, {1} m"
    values = inner, diameter
    require_numbers(lambda d, outer: d < outer, "inner_diameter", values, expected, METRES)
    return inner


def _length(argument: str, value: Number) -> Number:
    return _number(argument, value, METRES)


def _number(argument: str, value: Number, remedy: str) -> Number:
    """Return a value as an array, (), after a check that it is one positive number."""
    number = as_number(value)
    require_positive(argument, number, remedy)
    return number
