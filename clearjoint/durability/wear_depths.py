"""Reduction for the depths that wear removes around a bearing and its journal."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..math.functions import polar_angle
from ..math.vectors import Scalar
from ..model.clearance_joints.clearance import ClearanceJoint
from ..model.clearance_joints.journal_bases import BASES
from ..model.profiles import overlaps
from ..quantities.instant import Instant
from ..simulation.reductions.reductions import AbstractWindowedReduction
from ..simulation.reductions.wear import sliding_speed

Depths = tuple[jnp.ndarray, jnp.ndarray]
"""Depths, m, or their rates, m/s, of the wall and of the journal, (samples,) each."""


class WearDepths(AbstractWindowedReduction):
    """Depths that the contacts of a `ClearanceJoint` remove from the wall and from the journal.

    The volume that wears off in a time dt is k F v dt, with the specific wear rate k of a part, the
    normal force F of a base and the sliding speed v (J. F. Archard 1953). It is distributed in
    proportion to the overlap of the two profiles, as if the wall were an elastic foundation, over
    the whole length of the journal. Both bases count together. The results are named "bearing 1",
    "bearing 2", ..., "journal 1", ..., for evenly spaced angles from the x axis of each part's
    frame.

    **Arguments:**

    - `joint`: its name.
    - `bearing_rate`, `journal_rate`: k of each part, m^2/N; zero for a part that doesn't wear.
    - `samples`: number of angles.
    - `after`, `until`: s, the window of time.
    """

    joint: str = eqx.field(static=True)
    bearing_rate: float = eqx.field(static=True)
    journal_rate: float = eqx.field(static=True)
    samples: int = eqx.field(static=True)

    def start(self, now: Instant) -> tuple[Scalar, Depths, Depths]:
        """Return the tally at the start: the time, s, the rates there, m/s, and depths of zero."""
        nothing = jnp.zeros(self.samples)
        return now.time, self._rates(now), (nothing, nothing)

    def update(
        self, tally: tuple[Scalar, Depths, Depths], now: Instant
    ) -> tuple[Scalar, Depths, Depths]:
        """Return the tally with the wear of the part of the step that is in the window."""
        before, _, depths = tally
        a, b = self._window().fractions(before, now.time)
        length = (now.time - before) * (b - a)
        # Simpson's rule, with rates at both ends and in the middle of the part in the window.
        rates = [self._rates(now.inside(x)) for x in (a, 0.5 * (a + b), b)]
        worn = tuple(
            depth + length / 6.0 * (first + 4.0 * middle + last)
            for depth, first, middle, last in zip(depths, *rates, strict=True)
        )
        return now.time, rates[-1], worn

    def results(self, tally: tuple[Scalar, Depths, Depths], now: Instant) -> dict[str, Scalar]:
        """Return the depths, m, by name; NaN if the run ended before the window."""
        window = self._window()
        return {
            f"{part} {k + 1}": window.if_reached(depths[k], now.time)
            for part, depths in zip(("bearing", "journal"), tally[2], strict=True)
            for k in range(self.samples)
        }

    def units(self) -> dict[str, str]:
        """Return "m" for each result."""
        names = (f"{p} {k + 1}" for p in ("bearing", "journal") for k in range(self.samples))
        return dict.fromkeys(names, "m")

    def _rates(self, now: Instant) -> Depths:
        """Return the rates of wear around the wall and around the journal, m/s."""
        bearing = journal = jnp.zeros(self.samples)
        for base in BASES:
            on_wall, on_journal = self._rates_at(now, base)
            bearing, journal = bearing + on_wall, journal + on_journal
        return bearing, journal

    def _rates_at(self, now: Instant, base: str) -> Depths:
        """Return the rates of wear by one base."""
        joint = now.scene.joints[self.joint]
        assert isinstance(joint, ClearanceJoint)
        force = now.contacts[self.joint][base].normal_force
        speed = sliding_speed(now, self.joint, base)
        offset = joint.journal_offset(now.motions, base)
        axes = joint.planar_axes(now.motions[joint.bearing_body], now.motions[joint.journal_body])
        spacing = 2.0 * np.pi / self.samples
        angles = np.arange(self.samples) * spacing
        # The sagitta of one spacing is added to the overlap, so that two angles at least share the
        # wear of a contact that is narrower than their distance.
        sagitta = 0.5 * joint.clearance * spacing**2

        def shares(wall_angles: Scalar) -> Scalar:
            overlap = overlaps(
                offset.x, offset.y, wall_angles, joint.bearing_profile, joint.journal_profile, axes
            )
            part = jnp.maximum(overlap - joint.clearance + sagitta, 0.0)
            total = jnp.sum(part)
            return part / jnp.where(total > 0.0, total, 1.0)

        def depth_rate(rate: float, radius: Scalar, wall_angles: Scalar) -> jnp.ndarray:
            if rate == 0.0:
                return jnp.zeros(self.samples)
            area = radius * spacing * joint.journal_length
            return rate * force * speed / area * shares(wall_angles)

        # The angle in the bearing's cross-section of each angle about the journal's own axis.
        own_x, own_y = np.cos(angles), np.sin(angles)
        on_wall = polar_angle(
            axes.x_along_y * own_x + axes.y_along_y * own_y,
            axes.x_along_x * own_x + axes.y_along_x * own_y,
        )
        return (
            depth_rate(self.bearing_rate, joint.bearing_radius, angles),
            depth_rate(self.journal_rate, joint.journal_radius, on_wall),
        )
