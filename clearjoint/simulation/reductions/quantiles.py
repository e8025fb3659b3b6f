"""Quantiles of a quantity over time, gathered along a run in bounded memory."""

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
from .reductions import AbstractReduction
from .windows import Instants, Window, optional_time

QuantilesTally: TypeAlias = tuple[tuple[Scalar, Scalar], Scalar, jax.Array]
"""The latest instant, s, and the value there; the duration inside the window, s; and for how much
of it, s, the quantity was below each edge, (K,)."""


class Quantiles(AbstractReduction):
    """Values below which a quantity is for parts of the time: "0.5" is the median over time.

    How long the quantity is below each of the `edges` is gathered, exactly of the parabola through
    both ends and the middle of each step; between two edges a quantile is interpolated. So it lies
    between the edges about the true one, and is wrong by less than their distance. A level whose
    quantile is below the first edge or above the last is NaN: widen the edges.

    For quantiles over the impacts instead of over time take `ImpactTable`; these are exact.

    ```python
    import clearjoint as cj
    import numpy as np

    edges = [0.0, *np.geomspace(1.0, 1e5, 200)]  # N: wrong by 6 % at most
    force = cj.quantities.ContactForce("shoulder")
    outputs = {"force": cj.Quantiles(force, "N", edges, levels=(0.5, 0.99), after=0.5)}
    ```

    **Arguments:**

    - `quantity`, `unit`: as for `Peak`.
    - `edges`: (K,) rising, in the unit; two at least. Memory and time of a step grow with them.
    - `levels`: between 0 and 1, of which the results have the names.
    - `after`, `until`: s, the window; from the start to the end of the run unless given.

    **Raises:** `ValueError` for edges that do not rise, and levels that are no part.
    """

    quantity: Quantity = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    edges: tuple[float, ...] = eqx.field(static=True, converter=numbers)
    levels: tuple[float, ...] = eqx.field(static=True, converter=numbers, default=(0.5, 0.95))
    after: Instants = eqx.field(default=None, static=True, converter=optional_time)
    until: Instants = eqx.field(default=None, static=True, converter=optional_time)

    def __check_init__(self):
        edges, remedy = np.asarray(self.edges), "sort them, two at least, none of them twice"
        require_finite("edges", edges)
        rising = len(edges) > 1 and bool((np.diff(edges) > 0).all())
        require(rising, "edges", self.edges, "rising", remedy)
        levels = np.asarray(as_number(self.levels))
        parts = len(levels) > 0 and bool(((levels > 0) & (levels < 1)).all())
        require(parts, "levels", self.levels, "between 0 and 1", "give 0.95 for 95 %")
        self._window()

    def _window(self) -> Window:
        return Window(self.after, self.until)

    def start(self, now: Instant) -> QuantilesTally:
        """The instant and the value there, and no time below any edge."""
        return (now.time, self._value(now)), jnp.zeros(()), jnp.zeros(len(self.edges))

    def update(self, tally: QuantilesTally, now: Instant) -> QuantilesTally:
        """The tally with the part of the step added that is inside the window."""
        (before, value), duration, below = tally
        end, length = self._value(now), now.time - before
        arc = Parabola.through(value, self._value(now.middle), end)
        a, b = self._window().places(before, now.time)
        inside = jnp.where(b > a, length, 0.0)
        added = inside * arc.part_below(jnp.asarray(self.edges), a, b)
        return (now.time, end), duration + inside * (b - a), below + added

    def _value(self, now: Instant) -> Scalar:
        return jnp.asarray(self.quantity(now), dtype=float)

    def results(self, tally: QuantilesTally, now: Instant) -> dict[str, Scalar]:
        """The quantile of each level; NaN where no edges enclose it, or the run ended before the
        window."""
        del now
        _, duration, below = tally
        edges, last = jnp.asarray(self.edges), len(self.edges) - 1
        found = {}
        for level in self.levels:
            target = level * duration
            k = jnp.sum(below < target)
            above = jnp.clip(k, 1, last)
            low, high = below[above - 1], below[above]
            part = (target - low) / jnp.where(high > low, high - low, 1.0)
            value = edges[above - 1] + part * (edges[above] - edges[above - 1])
            enclosed = (k >= 1) & (k <= last)
            found[f"{level:g}"] = jnp.where(enclosed, value, jnp.nan)
        return found

    def units(self) -> dict[str, str]:
        """The quantity's unit for each level."""
        return {f"{level:g}": self.unit for level in self.levels}
