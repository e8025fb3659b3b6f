"""Observations with few of their parts, for tests of what reads them."""

import dataclasses
from collections.abc import Sequence

import jax
import numpy as np

import clearjoint as cj
from tests.support.tumbling_bearing import solution_of

NEEDED = {
    field.name
    for field in dataclasses.fields(cj.results.Observation)
    if field.default is dataclasses.MISSING
}


def observation_of(times: np.ndarray, **parts: object) -> cj.results.Observation:
    """Return an `Observation` at `times`, (N,) s, that has nothing but `parts`."""
    empty = dict.fromkeys(NEEDED - {"times", "reactions_unique"}, {})
    return cj.results.Observation(**empty | {"times": times, "reactions_unique": True} | parts)


def observed(scene: cj.Scene, body: str, states: Sequence[cj.BodyState]) -> cj.results.Observation:
    """What is observed of a scene of one body, which is in one state after the other."""
    batch = jax.tree.map(lambda *leaves: np.stack(leaves), *states)
    saved = cj.results.Trajectory(np.arange(float(len(states))), cj.State({body: batch}))
    return cj.observe(scene, solution_of(saved), saved)
