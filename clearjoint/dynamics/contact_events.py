"""Penetrations of contacts, the events at which contacts begin and end, and entry speeds.

A contact is closed while its penetration, measured from the onset of its force, is positive. When a
step lands on an onset, its end is slightly past it; there, the entry speed is computed by one
Newton step back to zero penetration. So the entry speed and its derivatives are those at the onset.
`clearjoint.simulation.step.landing` adjusts the step's length.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TypeAlias

import jax
import jax.numpy as jnp

from ..math.groups import any_, min_
from ..math.vectors import Condition, Scalar
from ..model.contact.laws import UNKNOWN_ENTRY_SPEED
from ..model.joints.base import ByLabel, Motions
from ..model.scene import Scene
from .contact_forces import Closed, EntrySpeeds

SLOWEST = 1e-12
"""m/s: smallest entry speed that is stored, since zero stands for an open contact."""
TOUCHING = 1e-12
"""m: largest depth, positive or negative, at which a contact counts as being at the wall at the
start of a run. The true depth is zero, and its sign is due to rounding."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class ContactGap:
    """Penetration of a contact.

    - `depth`: m, measured from the onset of the contact's force, negative in flight.
    - `rate`: m/s, time derivative of the penetration.
    """

    depth: Scalar
    rate: Scalar


ContactGaps: TypeAlias = ByLabel[ContactGap]


def contact_gaps(scene: Scene, motions: Motions) -> ContactGaps:
    """Return penetration and rate of each contact, by joint and contact label."""
    depths_and_rates: ContactGaps = {}
    for name, joint in scene.contact_joints().items():
        laws = joint.laws()
        depths_and_rates[name] = {
            label: ContactGap(contact.gap.depth + laws[label].onset_offset(), contact.gap.rate)
            for label, contact in joint.contacts(motions).items()
        }
    return depths_and_rates


def gap_pairs(before: ContactGaps, after: ContactGaps) -> Iterator[tuple[ContactGap, ContactGap]]:
    """Yield for each contact of a scene its gap at a first and at a second instant."""
    for name, family in before.items():
        for label, start in family.items():
            yield start, after[name][label]


def _all_gaps(gaps: ContactGaps) -> Iterator[ContactGap]:
    for family in gaps.values():
        yield from family.values()


def any_of(conditions: Iterable[Condition]) -> jax.Array:
    """Return whether any condition is true, as a boolean of shape ().

    A condition may be an array with one element for each contact of a group.
    """
    any_true = jnp.asarray(False)
    for condition in conditions:
        any_true = any_true | any_(condition)
    return any_true


def uses_entry_speed(scene: Scene) -> bool:
    """Return whether the force of any contact in the scene depends on its entry speed."""
    return any(law.uses_entry_speed for family in scene.laws().values() for law in family.values())


def initial_entry_speeds(scene: Scene, start: ContactGaps) -> EntrySpeeds:
    """Return the entry speeds at the start of a run, m/s, by joint and contact label, of the
    contacts whose laws use them.

    - A contact in flight gets zero.
    - A contact that is just beginning (depth positive, but at most `TOUCHING`) gets its rate.
    - A deeper contact gets `UNKNOWN_ENTRY_SPEED`, by which its force is elastic, since its impact
      was before the start.

    `start` holds the gaps at the start of the run.
    """

    def entry_speed(name: str, label: str) -> Scalar:
        gap = start[name][label]
        present = jnp.where(_at_the_wall(gap), _entry_speed(gap.rate), UNKNOWN_ENTRY_SPEED)
        return jnp.where(gap.depth > 0.0, present, 0.0)

    return _for_each_entry_speed(scene, entry_speed)


def _entry_speed(rate: Scalar) -> Scalar:
    """Return the entry speed, m/s, of a contact that begins at a given penetration rate; at least
    `SLOWEST`."""
    return jnp.maximum(rate, SLOWEST)


def _at_the_wall(gap: ContactGap) -> Condition:
    """Return whether the depth of a contact is zero except for rounding."""
    return jnp.abs(gap.depth) <= TOUCHING


def _for_each_entry_speed(scene: Scene, entry_speed: Callable[[str, str], Scalar]) -> EntrySpeeds:
    entry_speeds = {}
    for name, family in scene.laws().items():
        labels = [label for label, law in family.items() if law.uses_entry_speed]
        if labels:
            entry_speeds[name] = {label: entry_speed(name, label) for label in labels}
    return entry_speeds


def closed(gaps: ContactGaps) -> Closed:
    """Return whether each contact has a positive penetration, by joint and contact label.

    If steps land on contact events, a contact stays open or closed for a whole step. A trial step
    past a wall then meets no force: it is as smooth as flight, and the time of the crossing is
    found from it at once.
    """
    return {
        name: {label: gap.depth > 0.0 for label, gap in family.items()}
        for name, family in gaps.items()
    }


def begins(before: ContactGaps, after: ContactGaps) -> jax.Array:
    """Return whether any contact is open at the first of two instants and closed at the second."""
    return any_of(
        (start.depth <= 0.0) & (end.depth > 0.0) for start, end in gap_pairs(before, after)
    )


def changes(before: ContactGaps, after: ContactGaps) -> Condition:
    """Return whether any contact is closed at exactly one of two instants."""
    return any_of(
        (start.depth > 0.0) != (end.depth > 0.0) for start, end in gap_pairs(before, after)
    )


def touches(gaps: ContactGaps) -> Condition:
    """Return whether any contact is closed."""
    return any_of(gap.depth > 0.0 for gap in _all_gaps(gaps))


def time_since_onset(before: ContactGaps, after: ContactGaps) -> Scalar:
    """Return the time, s, from the latest onset between two instants to the second, or infinity if
    no contact begins.

    It is depth over rate at the second instant, correct to first order, and not differentiated.
    """
    latest: Scalar = jnp.inf
    for start, end in gap_pairs(before, after):
        began = (start.depth <= 0.0) & (end.depth > 0.0)
        since = end.depth / jnp.where(end.rate > SLOWEST, end.rate, jnp.inf)
        latest = jnp.minimum(latest, min_(jnp.where(began, since, jnp.inf)))
    return jax.lax.stop_gradient(latest)


def begins_at_start(gaps: ContactGaps) -> jax.Array:
    """Return whether any contact has a positive depth of at most `TOUCHING`, and so begins at this
    instant."""
    return any_of((gap.depth > 0.0) & _at_the_wall(gap) for gap in _all_gaps(gaps))


def too_deep(scene: Scene, gaps: ContactGaps) -> jax.Array:
    """Return whether any contact is deeper than the geometry of its joint allows (`deepest`)."""
    return any_of(
        gaps[name][label].depth > limit
        for name, joint in scene.contact_joints().items()
        for label, limit in joint.deepest().items()
    )


def updated_entry_speeds(
    scene: Scene,
    entry_speeds: EntrySpeeds,
    before: ContactGaps,
    after: ContactGaps,
    second_rates: ByLabel[Scalar],
) -> EntrySpeeds:
    """Return the entry speeds after an accepted step, m/s, by joint and contact label.

    A contact that began in the step gets its penetration rate at the onset, an open contact zero,
    and any other keeps its entry speed.

    **Arguments:**

    - `entry_speeds`: m/s, before the step.
    - `before`, `after`: contact gaps at the start and at the end of the step.
    - `second_rates`: second time derivatives of the depths at the end of the step, m/s^2.
    """

    def update(name: str, label: str) -> Scalar:
        end = after[name][label]
        began = (before[name][label].depth <= 0.0) & (end.depth > 0.0)
        usable = end.rate > SLOWEST
        # The step ends slightly past the onset. One Newton step goes back by depth over rate; in
        # this time the rate changes by second rate times time. The correction of the value is
        # negligible, but it makes the derivative that of the rate at the moving instant of onset.
        back = end.depth / jnp.where(usable, end.rate, 1.0)
        entry = jnp.where(usable, end.rate - second_rates[name][label] * back, end.rate)
        # In a grazing contact the correction may exceed the rate.
        entry = jnp.where(entry > 0.0, entry, _entry_speed(end.rate))
        return jnp.where(end.depth > 0.0, jnp.where(began, entry, entry_speeds[name][label]), 0.0)

    return _for_each_entry_speed(scene, update)
