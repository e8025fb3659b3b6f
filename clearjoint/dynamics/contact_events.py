"""Begin and end of contacts, and the memory of the entry speed.

A contact exists where its penetration, measured from where the force begins, is positive. Its
memory is set at the end of the step that lands on its begin, by one Newton step back to the instant
where the gap is zero, so that value and derivative are those of the event. The steps that land
there are in `clearjoint.simulation.step.landing`.
"""

from collections.abc import Callable
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
"""m/s: the smallest entry speed on record."""
TOUCHING = 1e-12
"""m: a start so near the wall is at the wall, on whichever side rounding puts it."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class ContactGap:
    """Penetration of a contact from where its force begins, m, and its rate, m/s."""

    depth: Scalar
    rate: Scalar


ContactGaps: TypeAlias = ByLabel[ContactGap]


def contact_gaps(scene: Scene, motions: Motions) -> ContactGaps:
    """Depth and rate of each contact, by joint and contact."""
    depths_and_rates: ContactGaps = {}
    for name, joint in scene.contact_joints().items():
        laws = joint.laws()
        depths_and_rates[name] = {
            label: ContactGap(contact.gap.depth + laws[label].onset_offset(), contact.gap.rate)
            for label, contact in joint.contacts(motions).items()
        }
    return depths_and_rates


def uses_entry_speed(scene: Scene) -> bool:
    """Whether any law of the scene keeps an impact memory."""
    return any(law.uses_entry_speed for family in scene.laws().values() for law in family.values())


def initial_entry_speeds(scene: Scene, start: ContactGaps) -> EntrySpeeds:
    """Zero in flight. A contact that begins at the start has its rate as entry speed; one present
    before counts as elastic, since its impact is unknown."""

    def entry_speed(name: str, label: str) -> Scalar:
        gap = start[name][label]
        present = jnp.where(_at_the_wall(gap), _entry_speed(gap.rate), UNKNOWN_ENTRY_SPEED)
        return jnp.where(gap.depth > 0.0, present, 0.0)

    return _for_each_entry_speed(scene, entry_speed)


def _entry_speed(rate: Scalar) -> Scalar:
    """The entry speed of a contact that begins at a rate: never zero, which stands for flight."""
    return jnp.maximum(rate, SLOWEST)


def _at_the_wall(gap: ContactGap) -> Condition:
    """Whether a contact is neither open nor closed but for rounding."""
    return jnp.abs(gap.depth) <= TOUCHING


def _for_each_entry_speed(scene: Scene, entry_speed: Callable[[str, str], Scalar]) -> EntrySpeeds:
    entry_speeds = {}
    for name, family in scene.laws().items():
        labels = [label for label, law in family.items() if law.uses_entry_speed]
        if labels:
            entry_speeds[name] = {label: entry_speed(name, label) for label in labels}
    return entry_speeds


def closed(here: ContactGaps) -> Closed:
    """Which contacts exist.

    Where steps land on their begin and end, a contact stays open or closed for a whole step. A
    trial step that goes past a wall then meets nothing: what it says of the way to the wall is as
    smooth as in flight, and where it crosses is found at once.
    """
    return {
        name: {label: gap.depth > 0.0 for label, gap in family.items()}
        for name, family in here.items()
    }


def begins(before: ContactGaps, after: ContactGaps) -> jax.Array:
    """Whether any contact begins between two instants."""
    any_begins = jnp.asarray(False)
    for name, family in before.items():
        for label, start in family.items():
            any_begins = any_begins | any_((start.depth <= 0.0) & (after[name][label].depth > 0.0))
    return any_begins


def changes(before: ContactGaps, after: ContactGaps) -> Condition:
    """Whether any contact begins or ends between two instants."""
    any_changes: Condition = jnp.asarray(False)
    for name, family in before.items():
        for label, start in family.items():
            any_changes |= any_((start.depth > 0.0) != (after[name][label].depth > 0.0))
    return any_changes


def touches(here: ContactGaps) -> Condition:
    """Whether any contact exists."""
    any_touches: Condition = jnp.asarray(False)
    for family in here.values():
        for gap in family.values():
            any_touches = any_touches | any_(gap.depth > 0.0)
    return any_touches


def time_since_begin(before: ContactGaps, after: ContactGaps) -> Scalar:
    """Time in s for which the latest of the contacts exists that begin between two instants."""
    latest: Scalar = jnp.inf
    for name, family in before.items():
        for label, start in family.items():
            end = after[name][label]
            began = (start.depth <= 0.0) & (end.depth > 0.0)
            since = end.depth / jnp.where(end.rate > SLOWEST, end.rate, jnp.inf)
            latest = jnp.minimum(latest, min_(jnp.where(began, since, jnp.inf)))
    return jax.lax.stop_gradient(latest)


def begins_at_once(here: ContactGaps) -> jax.Array:
    """Whether any contact begins at the instant itself: closed, but at the wall."""
    any_begins = jnp.asarray(False)
    for family in here.values():
        for gap in family.values():
            any_begins = any_begins | any_((gap.depth > 0.0) & _at_the_wall(gap))
    return any_begins


def too_deep(scene: Scene, here: ContactGaps) -> jax.Array:
    """Whether any contact is deeper than its joint can make sense of."""
    deeper = jnp.asarray(False)
    for name, joint in scene.contact_joints().items():
        for label, limit in joint.deepest().items():
            deeper = deeper | any_(here[name][label].depth > limit)
    return deeper


def updated_entry_speeds(
    scene: Scene,
    entry_speeds: EntrySpeeds,
    before: ContactGaps,
    after: ContactGaps,
    second_rates: ByLabel[Scalar],
) -> EntrySpeeds:
    """Memory after an accepted step: set where a contact began, cleared where it ended.

    `second_rates[joint][contact]` are the second derivatives of the depths at the end of the step,
    m/s^2. The entry speed is the rate less what one Newton step back to zero depth takes off.
    """

    def update(name: str, label: str) -> Scalar:
        end = after[name][label]
        began = (before[name][label].depth <= 0.0) & (end.depth > 0.0)
        usable = end.rate > SLOWEST
        back = end.depth / jnp.where(usable, end.rate, 1.0)
        entry = jnp.where(usable, end.rate - second_rates[name][label] * back, end.rate)
        entry = jnp.where(entry > 0.0, entry, _entry_speed(end.rate))
        return jnp.where(end.depth > 0.0, jnp.where(began, entry, entry_speeds[name][label]), 0.0)

    return _for_each_entry_speed(scene, update)
