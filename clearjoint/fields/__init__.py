"""What every type of the package is built of: fields with units, their conversion to arrays and
their checks, cautions about unusual numbers, and how types print. Nothing here knows mechanics."""
