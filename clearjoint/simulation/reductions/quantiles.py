"""Quantiles of a quantity over time, found during a run in a fixed amount of memory."""

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
"""State of `Quantiles`: (latest time, s, and the value there), the duration inside the window, s,
and the part of that duration for which the quantity was below each edge, s, (K,)."""


class Quantiles(AbstractWindowedReduction):
    """Quantiles of a quantity over time: values below which it stays for given parts of the time.

    Each result is named after its level, such as "0.5" for the median, and has the unit of the
    quantity. In each step the quantity is approximated by the parabola through both ends and the
    middle. The time for which the quantity is below each of the `edges` is added up; between two
    edges, the quantile is interpolated. Its error is less than the distance of these edges. A
    quantile below the first edge or above the last edge is NaN: widen the edges.

    For quantiles over impacts instead of over time, use `ImpactTable`, whose quantiles are exact.

    ```python
    import clearjoint as cj
    import numpy as np

    edges = [0.0, *np.geomspace(1.0, 1e5, 200)]  # N: error of 6 % at most
    force = cj.quantities.ContactForce("shoulder")
    outputs = {"force": cj.Quantiles(force, "N", edges, levels=(0.5, 0.99), after=0.5)}
    ```

    **Arguments:**

    - `quantity`: function of an `Instant` that returns a scalar; `unit`: its unit.
    - `edges`: (K,) increasing values in `unit`, K at least 2. Memory and time of a step grow with
      K.
    - `levels`: parts of the time, between 0 and 1, one for each quantile.
    - `after`, `until`: s, the window of time, by default the whole run. All results are NaN if the
      run ended before the window.

    **Raises:** `ValueError` for edges that do not increase, for levels outside 0 to 1, and for a
    window that does not end after its start.
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
        """Return the tally at the start of the run, with durations of zero."""
        return (now.time, self._value(now)), jnp.zeros(()), jnp.zeros(len(self.edges))

    def update(self, tally: QuantilesTally, now: Instant) -> QuantilesTally:
        """Return the tally with the part of the step that is in the window added."""
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
        """Return the quantile of each level by name, such as "0.95"; NaN if the quantile is outside
        of the edges, or if the run ended before the window."""
        del now
        _, duration, below = tally
        edges, last = jnp.asarray(self.edges), len(self.edges) - 1
        quantiles = {}
        for level in self.levels:
            target = level * duration
            # k edges are below the quantile. It is interpolated between edge k - 1 and edge k; k is
            # clipped so that both exist, and the result is replaced by NaN if the clip was needed.
            k = jnp.sum(below < target)
            above = jnp.clip(k, 1, last)
            low, high = below[above - 1], below[above]
            part = (target - low) / jnp.where(high > low, high - low, 1.0)
            value = edges[above - 1] + part * (edges[above] - edges[above - 1])
            enclosed = (k >= 1) & (k <= last)
            quantiles[f"{level:g}"] = jnp.where(enclosed, value, jnp.nan)
        return quantiles

    def units(self) -> dict[str, str]:
        """Return the unit of the quantity for each level."""
        return {f"{level:g}": self.unit for level in self.levels}
