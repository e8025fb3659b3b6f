"""Reductions of the energy that joints dissipate: its sum and its mean power."""

from typing import NamedTuple

import jax.numpy as jnp

from ...math.vectors import Scalar, add
from ...quantities.instant import Instant
from .reductions import AbstractWindowedReduction
from .windows import Window

LOSSES = ("normal damping", "friction", "film")
"""Names of the entries of `Instant.work`, J, that are losses in joints."""


class LossTally(NamedTuple):
    """State of the reductions of losses after an accepted step.

    - `time`: the latest instant, s.
    - `at_begin`, `at_end`: losses, J, from the start of the run to the start and to the end of the
      window; to the latest instant if that is earlier.
    """

    time: Scalar
    at_begin: Scalar
    at_end: Scalar


class DissipatedEnergy(AbstractWindowedReduction):
    """Energy, J, dissipated by normal damping, friction and films; needs `Settings(ledger=True)`.

    **Arguments:** `after`, `until`: s, the window of time, by default the whole run. The result is
    NaN if the run ended before the window.

    **Raises:** `ValueError` for a window that does not end after its start.

    >>> outputs = {"losses": cj.DissipatedEnergy()}  # needs Settings(ledger=True)
    >>> outputs["losses"].needs_ledger
    True
    """

    needs_ledger = True

    def start(self, now: Instant) -> LossTally | None:
        """Return the losses at the start; ``None`` without a window: the variables of the run then
        contain the result, so no tally is needed."""
        if self._window().is_whole:
            return None
        return LossTally(now.time, _lost(now), _lost(now))

    def update(self, tally: LossTally | None, now: Instant) -> LossTally | None:
        """Return the tally with the losses at the edges of the window updated; ``None`` stays."""
        if tally is None:
            return None
        return _lost_until(tally, now, self._window())

    def results(self, tally: LossTally | None, now: Instant) -> dict[str, Scalar]:
        """Return the dissipated energy, J, in the window or, without one, since the start. Energy
        stored in bristles is not counted as dissipated."""
        if tally is None:
            return {"": _lost(now)}
        return {"": self._window().if_reached(tally.at_end - tally.at_begin, now.time)}

    def units(self) -> dict[str, str]:
        """Return "J" for the energy."""
        return {"": "J"}


class MeanPowerLost(AbstractWindowedReduction):
    """Mean power, W, lost to normal damping, friction and films; needs `Settings(ledger=True)`.

    **Arguments:** `after`, `until`: s, the window of time of the mean, by default the whole run. If
    the run ends inside the window, the mean is over the part up to the run's end; the result is NaN
    if the run ended before the window.

    **Raises:** `ValueError` for a window that does not end after its start.

    >>> outputs = {"heating": cj.MeanPowerLost(after=0.5)}  # needs Settings(ledger=True)
    >>> outputs["heating"].units()
    {'': 'W'}
    """

    needs_ledger = True

    def start(self, now: Instant) -> tuple[Scalar, LossTally]:
        """Return the time at which the run starts, s, and the tally of losses there."""
        return now.time, LossTally(now.time, _lost(now), _lost(now))

    def update(self, tally: tuple[Scalar, LossTally], now: Instant) -> tuple[Scalar, LossTally]:
        """Return the tally with the losses at the edges of the window updated."""
        begin, losses = tally
        return begin, _lost_until(losses, now, self._window())

    def results(self, tally: tuple[Scalar, LossTally], now: Instant) -> dict[str, Scalar]:
        """Return the mean power, W, over the part of the window that the run reached; NaN if
        none."""
        begin, losses = tally
        window = self._window()
        duration = jnp.minimum(now.time, window.end) - jnp.maximum(begin, window.start)
        reached = duration > 0.0
        lost = losses.at_end - losses.at_begin
        return {"": jnp.where(reached, lost / jnp.where(reached, duration, 1.0), jnp.nan)}

    def units(self) -> dict[str, str]:
        """Return "W" for the mean power."""
        return {"": "W"}


def _lost_until(tally: LossTally, now: Instant, window: Window) -> LossTally:
    """Return the tally after the step that ends at `now`.

    Until the run reaches an edge of the window, the tally has the latest losses for the edge. The
    step across the edge sets them to the losses at the edge, by dense output; then they stay.
    """
    lost = _lost(now)
    # Before the edge: the losses so far. In the step across the edge: the losses at the edge. After
    # it: the losses that are known.
    at_edges = [
        jnp.where(now.time <= edge, lost, jnp.where(tally.time < edge, _lost(inside), known))
        for edge, inside, known in zip(
            (window.start, window.end),
            map(now.inside, window.fractions(tally.time, now.time)),
            (tally.at_begin, tally.at_end),
            strict=True,
        )
    ]
    return LossTally(now.time, *at_edges)


def _lost(now: Instant) -> Scalar:
    """Return the energy dissipated since the start of the run, J, without the energy in
    bristles."""
    lost: Scalar = 0.0
    for name in LOSSES:
        lost = add(lost, now.work.get(name, 0.0))
    if (stored := now.bristle_energy) is not None:
        lost = lost - stored
    return lost
