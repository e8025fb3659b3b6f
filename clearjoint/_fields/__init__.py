"""Fields of the classes of this package, independent of mechanics.

The modules declare units and allowed values, convert given values to arrays, check them, warn of
unusual numbers, and print objects.
"""
