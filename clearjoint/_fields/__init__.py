"""Fields of the classes of this package, independent of mechanics: units, allowed and usual values,
conversion to arrays, checks, warnings, and printing."""
