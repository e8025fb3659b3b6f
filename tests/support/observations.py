"""Observations with few of their parts, for tests of what reads them."""

import dataclasses

import numpy as np

import clearjoint as cj

NEEDED = {
    field.name
    for field in dataclasses.fields(cj.results.Observation)
    if field.default is dataclasses.MISSING
}


def observation_of(times: np.ndarray, **parts: object) -> cj.results.Observation:
    """Return an `Observation` at `times`, (N,) s, that has nothing but `parts`."""
    empty = dict.fromkeys(NEEDED - {"times", "reactions_unique"}, {})
    return cj.results.Observation(**empty | {"times": times, "reactions_unique": True} | parts)
