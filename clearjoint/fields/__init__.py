"""Fields of the package's types, independent of mechanics: units, conversion to arrays, checks,
warnings about unusual numbers, and printing."""
