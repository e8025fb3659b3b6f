"""Penetrations of contacts, the events at which contacts begin and end, and entry speeds.

The entry speed is the penetration rate at the onset of the force. A step in which a contact begins
ends after the onset: the penetration rate at the step's end is corrected by one Newton iteration
back to zero penetration, so that value and derivatives are those of the rate at the onset.
"""

from collections.abc import Callable, Iterable, Iterator
from functools import reduce
from typing import TypeAlias

import jax
import jax.numpy as jnp

from .._math.smoothing import where
from .._math.vectors import Condition, Scalar, library
from .._model.contact.laws import UNKNOWN_ENTRY_SPEED
from .._model.joints.base import AbstractContactJoint, ByLabel, Motions, each_label
from .._model.scene import Scene
from .._model.tree_dataclass import tree_dataclass
from .contact_forces import Closed, EntrySpeeds
from .kinds import Kinds

SLOWEST = 1e-12
"""Entry speed, m/s, of a closed contact whose penetration rate is not positive, since zero means an
open contact. The time since the onset is estimated, as depth over rate, only for rates above it."""
TOUCHING = 1e-12
"""Largest magnitude of the depth, m, at which a contact counts as being at the wall at the start of
a run: the sign of so small a depth is due to rounding."""


@tree_dataclass
class ContactGap:
    """Penetration measured from the onset of a contact's force, m, and its rate of change, m/s."""

    depth: Scalar
    rate: Scalar


ContactGaps: TypeAlias = ByLabel[ContactGap]
"""A `ContactGap` for each contact."""


def contact_gaps(scene: Scene, motions: Motions) -> ContactGaps:
    kinds, joints = Kinds(scene), scene.contact_joints().items()
    return {name: dict(kinds.evaluate(_gaps_of_joint, joint, motions)) for name, joint in joints}


def _gaps_of_joint(joint: AbstractContactJoint, motions: Motions) -> list[tuple[str, ContactGap]]:
    laws = joint.laws()
    return [
        (label, ContactGap(contact.gap.depth + laws[label].onset_offset(), contact.gap.rate))
        for label, contact in joint.contacts(motions).items()
    ]


def gap_pairs(before: ContactGaps, after: ContactGaps) -> Iterator[tuple[ContactGap, ContactGap]]:
    for name, family in before.items():
        for label, start in family.items():
            yield start, after[name][label]


def _all_gaps(gaps: ContactGaps) -> Iterator[ContactGap]:
    for family in gaps.values():
        yield from family.values()


def any_of(conditions: Iterable[Condition]) -> jax.Array:
    # JAX traces this primitive in a fraction of the time that it takes for the operator `|`.
    arrays = [jnp.asarray(condition) for condition in conditions]
    return reduce(jax.lax.bitwise_or, arrays, jnp.asarray(False))


def uses_entry_speed(scene: Scene) -> bool:
    return any(law.uses_entry_speed for family in scene.laws().values() for law in family.values())


def initial_entry_speeds(
    scene: Scene,
    start: ContactGaps,
    given: EntrySpeeds | None = None,
    second_rates: ByLabel[Scalar] | None = None,
) -> EntrySpeeds:
    """Return, for the start of a run, the entry speeds of the contacts whose laws use them.

    A closed contact keeps a positive entry speed in `given`. If `given` has none, a contact that is
    just beginning (at most `TOUCHING` deep in the gaps `start`) gets its penetration rate at the
    onset. A deeper one, whose impact was before the start, gets `UNKNOWN_ENTRY_SPEED`, with which
    its force is elastic. `second_rates`, second time derivatives of the depths, m/s^2, affect only
    derivatives of the result; ``None``, the default, for zeros.
    """

    def entry_speed(name: str, label: str) -> Scalar:
        gap = start[name][label]
        second_rate = 0.0 if second_rates is None else second_rates[name][label]
        if_not_given = jnp.where(
            _at_the_wall(gap), _at_onset(gap, second_rate), UNKNOWN_ENTRY_SPEED
        )
        # A state that was saved inside a step, just after an onset, may have a positive depth but
        # still the entry speed of an open contact, zero, because the instant of the onset is only
        # estimated (`entry_speeds_inside`). As zero would make the force elastic, it is replaced.
        known_speed = (given or {}).get(name, {}).get(label, 0.0)
        is_closed = gap.depth > 0.0
        if_closed = jnp.where(known_speed > 0.0, known_speed, if_not_given)
        return jnp.where(is_closed, if_closed, 0.0)

    return _for_each_entry_speed(scene, entry_speed)


def approaches_unknown(scene: Scene, start: ContactGaps, given: EntrySpeeds) -> ByLabel[Scalar]:
    """Return, for the contacts whose laws use entry speeds, the penetration rate, m/s, of those
    that are closed, go deeper, and have no positive entry speed in `given`; zero for the others."""

    def rate(name: str, label: str) -> Scalar:
        gap = start[name][label]
        known_speed = given.get(name, {}).get(label, 0.0)
        numpy = library((gap.depth, gap.rate, known_speed))
        unknown = (gap.depth > TOUCHING) & numpy.logical_not(known_speed > 0.0)
        return where(unknown, numpy.maximum(gap.rate, 0.0), 0.0)

    return _for_each_entry_speed(scene, rate)


def entry_speeds_inside(
    scene: Scene, gaps: ContactGaps, left: Scalar, start: EntrySpeeds, end: EntrySpeeds
) -> EntrySpeeds:
    """Return the entry speeds at an instant inside of a step, a time `left`, s, before its end. The
    entry speed of a contact that has begun in the step before this instant is that in `end`, at the
    step's end; all others are those in `start`, at the step's start. Onsets are estimated from the
    `gaps` at the step's end."""

    def entry_speed(name: str, label: str) -> Scalar:
        before, after, gap = start[name][label], end[name][label], gaps[name][label]
        has_begun = gap.depth - gap.rate * left > -TOUCHING
        return jnp.where((before > 0.0) | jnp.logical_not(has_begun), before, after)

    return _for_each_entry_speed(scene, entry_speed)


def _at_onset(gap: ContactGap, second_rate: Scalar) -> Scalar:
    """Return the penetration rate, m/s, that a contact had at its onset shortly before, from its
    present gap and the second time derivative of its depth, m/s^2; always positive."""
    usable = gap.rate > SLOWEST
    # One Newton step goes back by the time depth over rate, in which the rate changes by second
    # rate times this time. The correction changes the value hardly at all. But with it, the
    # derivative is that of the rate at the onset, whose instant depends on the parameters.
    back = gap.depth / jnp.where(usable, gap.rate, 1.0)
    entry = jnp.where(usable, gap.rate - second_rate * back, 0.0)
    # If a contact hardly touches the wall, the correction may exceed the rate. The entry speed must
    # be positive, since zero stands for an open contact.
    return jnp.where(entry > 0.0, entry, jnp.maximum(gap.rate, SLOWEST))


def _at_the_wall(gap: ContactGap) -> Condition:
    return jnp.abs(gap.depth) <= TOUCHING


def _for_each_entry_speed(scene: Scene, entry_speed: Callable[[str, str], Scalar]) -> EntrySpeeds:
    entry_speeds: EntrySpeeds = {}
    for name, family in scene.laws().items():
        for label, law in family.items():
            if law.uses_entry_speed:
                entry_speeds.setdefault(name, {})[label] = entry_speed(name, label)
    return entry_speeds


def closed(gaps: ContactGaps) -> Closed:
    """Return whether each contact is closed. If steps end at contact events, the result at a step's
    start holds for the whole step: a contact that is open at the start has no force even beyond the
    wall, so that the motion is smooth."""
    return each_label(lambda name, label: gaps[name][label].depth > 0.0, gaps)


def begins(before: ContactGaps, after: ContactGaps) -> jax.Array:
    """Return whether any contact is open at the first of two instants, and closed at the second."""
    pairs = gap_pairs(before, after)
    return any_of((start.depth <= 0.0) & (end.depth > 0.0) for start, end in pairs)


def changes(before: ContactGaps, after: ContactGaps) -> Condition:
    """Return whether any contact is closed at exactly one of two instants."""
    pairs = gap_pairs(before, after)
    return any_of((start.depth > 0.0) != (end.depth > 0.0) for start, end in pairs)


def touches(gaps: ContactGaps) -> Condition:
    return any_of(gap.depth > 0.0 for gap in _all_gaps(gaps))


def time_since_onset(before: ContactGaps, after: ContactGaps) -> Scalar:
    """Return the time, s, from the latest onset between two instants to the second one; infinite
    without an onset. It is depth over rate, correct to first order, and is not differentiated."""
    latest: Scalar = jnp.inf
    for start, end in gap_pairs(before, after):
        began = (start.depth <= 0.0) & (end.depth > 0.0)
        # Without a penetration rate, no time can be estimated, and zero is taken.
        since = end.depth / jnp.where(end.rate > SLOWEST, end.rate, jnp.inf)
        latest = jnp.minimum(latest, jnp.where(began, since, jnp.inf))
    return jax.lax.stop_gradient(latest)


def begins_at_start(gaps: ContactGaps) -> jax.Array:
    """Return whether any contact begins at the start of a run, with a depth in (0, `TOUCHING`]."""
    return any_of((gap.depth > 0.0) & _at_the_wall(gap) for gap in _all_gaps(gaps))


def too_deep(scene: Scene, gaps: ContactGaps) -> jax.Array:
    """Return whether any contact is deeper than the limit `deepest` of its joint."""
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
    """Return the entry speeds after an accepted step, from the gaps `before` and `after` it. A
    contact that began in the step gets its penetration rate at the onset, an open one gets zero,
    and others keep theirs. `second_rates`: of the depths after the step, m/s^2."""

    def update(name: str, label: str) -> Scalar:
        end = after[name][label]
        began = (before[name][label].depth <= 0.0) & (end.depth > 0.0)
        entry = _at_onset(end, second_rates[name][label])
        is_closed = end.depth > 0.0
        if_closed = jnp.where(began, entry, entry_speeds[name][label])
        return jnp.where(is_closed, if_closed, 0.0)

    return _for_each_entry_speed(scene, update)
