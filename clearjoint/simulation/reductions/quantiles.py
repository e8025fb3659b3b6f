"""Quantiles of a quantity over time, accumulated during a run in bounded memory."""

from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...fields.checks import as_number, require, require_finite
from ...math.interpolation import Parabola
from ...math.vectors import Scalar
from ...quantities.base import Quantity, numbers
from ...quantities.instant import Instant
from .reductions import AbstractWindowedReduction

QuantilesTally: TypeAlias = tuple[tuple[Scalar, Scalar], Scalar, jax.Array]
"""The latest instant, s, and the value there; the duration inside the window, s; and the time in
it, s, for which the quantity was below each edge, (K,)."""


class Quantiles(AbstractWindowedReduction):
    """Quantiles of a quantity over time; "0.5" is the median.

    In each step the quantity is approximated by the parabola through both ends and the middle. The
    time for which it is below each of the `edges` is accumulated; between two edges, a quantile is
    interpolated. Its error is less than their distance. A quantile below the first edge or above
    the last one is NaN: widen the edges.

    For quantiles over impacts instead of over time, use `ImpactTable`; these are exact.

    ```python
    import clearjoint as cj
    import numpy as np

    edges = [0.0, *np.geomspace(1.0, 1e5, 200)]  # N: error of 6 % at most
    force = cj.quantities.ContactForce("shoulder")
    outputs = {"force": cj.Quantiles(force, "N", edges, levels=(0.5, 0.99), after=0.5)}
    ```

    **Arguments:**

    - `quantity`, `unit`: as for `Peak`.
    - `edges`: (K,), increasing, in the unit; two at least. Memory and time of a step grow with K.
    - `levels`: between 0 and 1; the results are named after them.
    - `after`, `until`: s, the window of time, as for `Peak`.

    **Raises:** `ValueError` for edges that do not increase, and for levels outside 0 to 1.
    """

    quantity: Quantity = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    edges: tuple[float, ...] = eqx.field(static=True, converter=numbers)
    levels: tuple[float, ...] = eqx.field(static=True, converter=numbers, default=(0.5, 0.95))

    def __check_init__(self):
        edges, remedy = np.asarray(self.edges), "sort them, two at least, none of them twice"
        require_finite("edges", edges)
        rising = len(edges) > 1 and bool((np.diff(edges) > 0).all())
        require(rising, "edges", self.edges, "rising", remedy)
        levels = np.asarray(as_number(self.levels))
        parts = len(levels) > 0 and bool(((levels > 0) & (levels < 1)).all())
        require(parts, "levels", self.levels, "between 0 and 1", "give 0.95 for 95 %")

    def start(self, now: Instant) -> QuantilesTally:
        """Return the instant and the value there, with zero durations."""
        return (now.time, self._value(now)), jnp.zeros(()), jnp.zeros(len(self.edges))

    def update(self, tally: QuantilesTally, now: Instant) -> QuantilesTally:
        """Add the part of the step that is inside the window."""
        (before, value), duration, below = tally
        end, length = self._value(now), now.time - before
        arc = Parabola.through(value, self._value(now.middle), end)
        a, b = self._window().fractions(before, now.time)
        inside = jnp.where(b > a, length, 0.0)
        added = inside * arc.part_below(jnp.asarray(self.edges), a, b)
        return (now.time, end), duration + inside * (b - a), below + added

    def _value(self, now: Instant) -> Scalar:
        return jnp.asarray(self.quantity(now), dtype=float)

    def results(self, tally: QuantilesTally, now: Instant) -> dict[str, Scalar]:
        """Return the quantile of each level; NaN if no edges enclose it, or if the run ended before
        the window."""
        del now
        _, duration, below = tally
        edges, last = jnp.asarray(self.edges), len(self.edges) - 1
        quantiles = {}
        for level in self.levels:
            target = level * duration
            k = jnp.sum(below < target)
            above = jnp.clip(k, 1, last)
            low, high = below[above - 1], below[above]
            part = (target - low) / jnp.where(high > low, high - low, 1.0)
            value = edges[above - 1] + part * (edges[above] - edges[above - 1])
            enclosed = (k >= 1) & (k <= last)
            quantiles[f"{level:g}"] = jnp.where(enclosed, value, jnp.nan)
        return quantiles

    def units(self) -> dict[str, str]:
        """Return the quantity's unit for each level."""
        return {f"{level:g}": self.unit for level in self.levels}
