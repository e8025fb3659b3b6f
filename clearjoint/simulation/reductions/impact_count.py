"""Number of impacts."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from ...math.vectors import Condition, Scalar
from ...model.scene import Scene
from ...quantities.base import require_known
from ...quantities.instant import Instant
from .reductions import AbstractWindowedReduction


class CountTally(NamedTuple):
    """Number of onsets so far, which contacts exist, and the latest instant, s, if there is a
    window."""

    count: Scalar
    touching: dict[str, Condition]
    time: Scalar | None


class ImpactCount(AbstractWindowedReduction):
    """Number of contact onsets, of all contacts of a joint.

    **Arguments:** `joint`: name of the joint; `after`, `until`: s, the window of time of the
    onsets, as for `Peak`.

    **Raises:** `ValueError` as `Peak`.

    >>> cj.ImpactCount("shoulder")
    ImpactCount(joint='shoulder')
    """

    joint: str = eqx.field(static=True)

    def check(self, scene: Scene) -> None:
        """Check that the scene has the joint, and that it has contacts."""
        require_known("joint", self.joint, scene.contact_joints())

    def _touching(self, now: Instant) -> dict[str, Condition]:
        return {label: gap.depth > 0.0 for label, gap in now.contact_gaps[self.joint].items()}

    def start(self, now: Instant) -> CountTally:
        """Return a count of zero, and which contacts exist."""
        time = None if self._window().is_whole else now.time
        return CountTally(jnp.zeros(()), self._touching(now), time)

    def update(self, tally: CountTally, now: Instant) -> CountTally:
        """Add one for each contact that did not exist before."""
        count, after = tally.count, self._touching(now)
        for label, touches in after.items():
            begins = touches & ~tally.touching[label]
            if tally.time is not None:
                begins = begins & self._window().holds(self._onset(label, tally.time, now))
            count = count + jnp.where(begins, 1.0, 0.0)
        return CountTally(count, after, None if tally.time is None else now.time)

    def _onset(self, label: str, before: Scalar, now: Instant) -> Scalar:
        """Return the onset of a contact in the step that ends now, s, by its depth and rate."""
        gap = now.contact_gaps[self.joint][label]
        since = gap.depth / jnp.where(gap.rate > 0.0, gap.rate, jnp.inf)
        return now.time - jnp.clip(since, 0.0, now.time - before)

    def results(self, tally: CountTally, now: Instant) -> dict[str, Scalar]:
        """Return the number of onsets up to the end of the run or of the window."""
        return {"": self._window().if_reached(tally.count, now.time)}

    def units(self) -> dict[str, str]:
        """Return 1, for a number without unit."""
        return {"": "1"}
