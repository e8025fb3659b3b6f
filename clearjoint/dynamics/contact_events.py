"""Contact gaps, the events at which contacts begin and end, and entry speeds.

A contact exists while its penetration, measured from the onset of its force, is positive. Its entry
speed is set at the end of the step that lands on the onset, by one Newton step back to the instant
of zero penetration, so that value and derivative are those of the event. The landing itself is in
`clearjoint.simulation.step.landing`.
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
"""m/s: the smallest entry speed that is stored."""
TOUCHING = 1e-12
"""m: a start within this depth of the wall counts as at the wall, on either side by rounding."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class ContactGap:
    """Penetration of a contact from the onset of its force, m, and its rate, m/s."""

    depth: Scalar
    rate: Scalar


ContactGaps: TypeAlias = ByLabel[ContactGap]


def contact_gaps(scene: Scene, motions: Motions) -> ContactGaps:
    """Return depth and rate of each contact, by joint and contact label."""
    depths_and_rates: ContactGaps = {}
    for name, joint in scene.contact_joints().items():
        laws = joint.laws()
        depths_and_rates[name] = {
            label: ContactGap(contact.gap.depth + laws[label].onset_offset(), contact.gap.rate)
            for label, contact in joint.contacts(motions).items()
        }
    return depths_and_rates


def gap_pairs(before: ContactGaps, after: ContactGaps) -> Iterator[tuple[ContactGap, ContactGap]]:
    """Yield the gaps of each contact at two instants."""
    for name, family in before.items():
        for label, start in family.items():
            yield start, after[name][label]


def _all_gaps(gaps: ContactGaps) -> Iterator[ContactGap]:
    for family in gaps.values():
        yield from family.values()


def any_of(conditions: Iterable[Condition]) -> jax.Array:
    """Whether any condition is true, of any element if contacts are grouped."""
    any_true = jnp.asarray(False)
    for condition in conditions:
        any_true = any_true | any_(condition)
    return any_true


def uses_entry_speed(scene: Scene) -> bool:
    """Whether the force of any contact depends on its entry speed."""
    return any(law.uses_entry_speed for family in scene.laws().values() for law in family.values())


def initial_entry_speeds(scene: Scene, start: ContactGaps) -> EntrySpeeds:
    """Return the entry speeds at the start of a run, m/s.

    Zero in flight. A contact that begins at the start has its rate as entry speed. One that already
    exists counts as elastic, since the speed of its impact is unknown.
    """

    def entry_speed(name: str, label: str) -> Scalar:
        gap = start[name][label]
        present = jnp.where(_at_the_wall(gap), _entry_speed(gap.rate), UNKNOWN_ENTRY_SPEED)
        return jnp.where(gap.depth > 0.0, present, 0.0)

    return _for_each_entry_speed(scene, entry_speed)


def _entry_speed(rate: Scalar) -> Scalar:
    """Return the entry speed of a contact that begins at a rate; never zero, which means flight."""
    return jnp.maximum(rate, SLOWEST)


def _at_the_wall(gap: ContactGap) -> Condition:
    """Whether a contact is on the wall, except for rounding."""
    return jnp.abs(gap.depth) <= TOUCHING


def _for_each_entry_speed(scene: Scene, entry_speed: Callable[[str, str], Scalar]) -> EntrySpeeds:
    entry_speeds = {}
    for name, family in scene.laws().items():
        labels = [label for label, law in family.items() if law.uses_entry_speed]
        if labels:
            entry_speeds[name] = {label: entry_speed(name, label) for label in labels}
    return entry_speeds


def closed(gaps: ContactGaps) -> Closed:
    """Return whether each contact is closed, which means that its penetration is positive.

    If steps land on contact events, a contact stays open or closed for a whole step. A trial step
    past a wall then meets no force: it is as smooth as flight, and the crossing is found at once.
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
    """Return whether any contact is closed at only one of two instants."""
    return any_of(
        (start.depth > 0.0) != (end.depth > 0.0) for start, end in gap_pairs(before, after)
    )


def touches(gaps: ContactGaps) -> Condition:
    """Return whether any contact is closed."""
    return any_of(gap.depth > 0.0 for gap in _all_gaps(gaps))


def time_since_onset(before: ContactGaps, after: ContactGaps) -> Scalar:
    """Return the time in s since the latest onset between two instants, to first order; infinite if
    no contact begins."""
    latest: Scalar = jnp.inf
    for start, end in gap_pairs(before, after):
        began = (start.depth <= 0.0) & (end.depth > 0.0)
        since = end.depth / jnp.where(end.rate > SLOWEST, end.rate, jnp.inf)
        latest = jnp.minimum(latest, min_(jnp.where(began, since, jnp.inf)))
    return jax.lax.stop_gradient(latest)


def begins_at_start(gaps: ContactGaps) -> jax.Array:
    """Return whether any contact begins at this instant: its depth is positive but negligible."""
    return any_of((gap.depth > 0.0) & _at_the_wall(gap) for gap in _all_gaps(gaps))


def too_deep(scene: Scene, gaps: ContactGaps) -> jax.Array:
    """Return whether any contact is deeper than the geometry of its joint allows."""
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
    """Return the entry speeds after an accepted step, m/s: set where a contact began in it, zero
    where one is open, otherwise unchanged.

    **Arguments:** `before`, `after`: the contact gaps at the start and end of the step;
    `second_rates`: second derivatives of the depths at its end, m/s^2.
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
