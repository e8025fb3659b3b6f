"""The command-line program `clearjoint`.

Its commands check a mechanism, simulate it once or for many values of its numbers, fit parameters
to measurements, and compute wear. These commands read a scene file, which describes the mechanism,
or a study file, which names a scene file and defines the computations. Further commands write
example files, print JSON Schemas, and draw the figures of existing results again.
"""
