"""The command-line program `clearjoint`.

Its commands check a mechanism, simulate it once or for many values of its numbers, fit parameters
to measurements, and compute wear. They read a scene file, which describes the mechanism, or a study
file, which names a scene file and defines these computations.
"""
