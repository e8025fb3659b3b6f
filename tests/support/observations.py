"""Observations with few of their parts, for tests of what reads them."""

import dataclasses

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


def observed(scene: cj.Scene, *states: cj.State) -> cj.results.Observation:
    """What is observed of a scene that is in one state after the other, with entry speeds of 1 m/s
    of all contacts."""
    bodies = jax.tree.map(lambda *leaves: np.stack(leaves), *(state.bodies for state in states))
    entry_speeds = {
        name: dict.fromkeys(joint.laws(), np.ones(len(states)))
        for name, joint in scene.contact_joints().items()
    }
    batch = cj.State(bodies, entry_speeds)
    saved = cj.results.Trajectory(np.arange(float(len(states))), batch)
    return cj.observe(scene, solution_of(saved), saved)


def penetrations(scene: cj.Scene, state: cj.State) -> dict[str, dict[str, float]]:
    """Penetrations in one state, m, by joint and contact."""
    return {
        joint: {label: float(contact.penetration[0]) for label, contact in family.items()}
        for joint, family in observed(scene, state).contacts.items()
    }
