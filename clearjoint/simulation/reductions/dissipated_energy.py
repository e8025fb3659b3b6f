"""Energy that joints dissipate."""

from typing import NamedTuple

import jax.numpy as jnp

from ...math.vectors import Scalar, add
from ...quantities.instant import Instant
from .reductions import AbstractWindowedReduction
from .windows import Window

LOSSES = ("normal damping", "friction", "film")
"""Entries of the energy ledger for losses in joints."""


class LossTally(NamedTuple):
    """The latest instant, s; and the losses, J, at the start and at the end of the window, or so
    far."""

    time: Scalar
    at_begin: Scalar
    at_end: Scalar


class DissipatedEnergy(AbstractWindowedReduction):
    """Energy dissipated by normal damping, friction and films; needs `Settings(ledger=True)`.

    **Arguments:** `after`, `until`: s, the window of time, as for `Peak`.

    **Raises:** `ValueError` as `Peak`.

    >>> outputs = {"losses": cj.DissipatedEnergy()}  # needs Settings(ledger=True)
    >>> outputs["losses"].needs_ledger
    True
    """

    needs_ledger = True

    def start(self, now: Instant) -> LossTally | None:
        """Return the losses at the start; without a window ``None``, since the ledger is integrated
        with the state."""
        if self._window().is_whole:
            return None
        return LossTally(now.time, _lost(now), _lost(now))

    def update(self, tally: LossTally | None, now: Instant) -> LossTally | None:
        """Update the losses at the start and end of the window."""
        if tally is None:
            return None
        return _lost_until(tally, now, self._window())

    def results(self, tally: LossTally | None, now: Instant) -> dict[str, Scalar]:
        """Return the dissipated energy since the start, or in the window, J, without the energy
        stored in bristles."""
        if tally is None:
            return {"": _lost(now)}
        return {"": self._window().if_reached(tally.at_end - tally.at_begin, now.time)}

    def units(self) -> dict[str, str]:
        """Return J."""
        return {"": "J"}


class MeanPowerLost(AbstractWindowedReduction):
    """Mean power dissipated by normal damping, friction and films; needs `Settings(ledger=True)`.

    **Arguments:** `after`, `until`: s, the window of time of the mean, as for `Peak`.

    **Raises:** `ValueError` as `Peak`.

    >>> outputs = {"heating": cj.MeanPowerLost(after=0.5)}  # needs Settings(ledger=True)
    >>> outputs["heating"].units()
    {'': 'W'}
    """

    needs_ledger = True

    def start(self, now: Instant) -> tuple[Scalar, LossTally]:
        """Return the time of the start, s, and the losses there."""
        return now.time, LossTally(now.time, _lost(now), _lost(now))

    def update(self, tally: tuple[Scalar, LossTally], now: Instant) -> tuple[Scalar, LossTally]:
        """Update the losses at the start and end of the window."""
        begin, losses = tally
        return begin, _lost_until(losses, now, self._window())

    def results(self, tally: tuple[Scalar, LossTally], now: Instant) -> dict[str, Scalar]:
        """Return the mean power over the window as far as it was reached, W; NaN if not at all."""
        begin, losses = tally
        window = self._window()
        duration = jnp.minimum(now.time, window.end) - jnp.maximum(begin, window.start)
        reached = duration > 0.0
        lost = losses.at_end - losses.at_begin
        return {"": jnp.where(reached, lost / jnp.where(reached, duration, 1.0), jnp.nan)}

    def units(self) -> dict[str, str]:
        """Return W."""
        return {"": "W"}


def _lost_until(tally: LossTally, now: Instant, window: Window) -> LossTally:
    """Update the losses at the edges of the window by the step that ends now.

    Before an edge they follow the losses so far; in the step that passes it they are those at the
    edge, by dense output; then they stay.
    """
    lost = _lost(now)
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
    """Return the dissipated energy since the start, J."""
    lost: Scalar = 0.0
    for name in LOSSES:
        lost = add(lost, now.work.get(name, 0.0))
    if (stored := now.bristle_energy) is not None:
        lost = lost - stored
    return lost
