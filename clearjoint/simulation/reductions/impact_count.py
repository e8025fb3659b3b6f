"""Reduction that counts the impacts of a joint."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from ...math.vectors import Condition, Scalar
from ...model.scene import Scene
from ...quantities.base import require_known
from ...quantities.instant import Instant
from .reductions import AbstractWindowedReduction


class CountTally(NamedTuple):
    """State of `ImpactCount` after an accepted step.

    - `count`: number of onsets so far.
    - `touching`: whether each contact exists, by contact label.
    - `time`: the latest instant, s; ``None`` if the window is the whole run.
    """

    count: Scalar
    touching: dict[str, Condition]
    time: Scalar | None


class ImpactCount(AbstractWindowedReduction):
    """Number of impacts of a joint: onsets of all of its contacts together.

    A contact that exists at the start of the run does not count.

    **Arguments:**

    - `joint`: name of the joint.
    - `after`, `until`: s, the window of time; onsets outside do not count. By default the whole
      run. The result is NaN if the run ended before the window.

    **Raises:** `ValueError` for a window that does not end after its start.

    >>> cj.ImpactCount("shoulder")
    ImpactCount(joint='shoulder')
    """

    joint: str = eqx.field(static=True)

    def check(self, scene: Scene) -> None:
        """Check that the scene has the joint, and that the joint has contacts.

        **Raises:** `ValueError` that lists the names of such joints.
        """
        require_known("joint", self.joint, scene.contact_joints())

    def _touching(self, now: Instant) -> dict[str, Condition]:
        return {label: gap.depth > 0.0 for label, gap in now.contact_gaps[self.joint].items()}

    def start(self, now: Instant) -> CountTally:
        """Return a tally with a count of zero and the contacts that exist at the start."""
        time = None if self._window().is_whole else now.time
        return CountTally(jnp.zeros(()), self._touching(now), time)

    def update(self, tally: CountTally, now: Instant) -> CountTally:
        """Return the tally with one added for each contact that began in the step."""
        count, after = tally.count, self._touching(now)
        for label, touches in after.items():
            begins = touches & ~tally.touching[label]
            if tally.time is not None:
                begins = begins & self._window().holds(self._onset(label, tally.time, now))
            count = count + jnp.where(begins, 1.0, 0.0)
        return CountTally(count, after, None if tally.time is None else now.time)

    def _onset(self, label: str, before: Scalar, now: Instant) -> Scalar:
        """Return the time at which a contact began, s, in the step from `before` to `now`.

        The penetration at the end of the step, over its rate there, is the time since the onset.
        """
        gap = now.contact_gaps[self.joint][label]
        since = gap.depth / jnp.where(gap.rate > 0.0, gap.rate, jnp.inf)
        return now.time - jnp.clip(since, 0.0, now.time - before)

    def results(self, tally: CountTally, now: Instant) -> dict[str, Scalar]:
        """Return the number of onsets in the window; NaN if the run ended before the window."""
        return {"": self._window().if_reached(tally.count, now.time)}

    def units(self) -> dict[str, str]:
        """Return "1": a count has no unit."""
        return {"": "1"}
