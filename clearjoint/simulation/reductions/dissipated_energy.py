"""What joints take of the energy."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from ...math.vectors import Scalar, add
from ...quantities.instant import Instant
from .reductions import AbstractReduction
from .windows import Instants, Window, optional_time

LOSSES = ("normal damping", "friction", "film")
"""Of the energy ledger, what joints take."""


class LossTally(NamedTuple):
    """The latest instant, s; and what had been lost, J, at the begin and at the end of the window,
    or so far."""

    time: Scalar
    at_begin: Scalar
    at_end: Scalar


class DissipatedEnergy(AbstractReduction):
    """Energy that normal damping, friction and films took; for `Settings(ledger=True)`.

    **Arguments:** `after`, `until`: s, the window of time, as for `Peak`.

    **Raises:** `ValueError` as `Peak`.

    >>> outputs = {"losses": cj.DissipatedEnergy()}  # needs Settings(ledger=True)
    >>> outputs["losses"].needs_ledger
    True
    """

    after: Instants = eqx.field(default=None, static=True, converter=optional_time)
    until: Instants = eqx.field(default=None, static=True, converter=optional_time)
    needs_ledger = True

    def __check_init__(self):
        self._window()

    def _window(self) -> Window:
        return Window(self.after, self.until)

    def start(self, now: Instant) -> LossTally | None:
        """Nothing is remembered, since the ledger is integrated with the state; of a window, what
        is lost where it begins and ends."""
        if self._window().is_whole:
            return None
        return LossTally(now.time, _lost(now), _lost(now))

    def update(self, tally: LossTally | None, now: Instant) -> LossTally | None:
        """The losses up to the window's begin and end, as far as the step goes."""
        if tally is None:
            return None
        return _lost_until(tally, now, self._window())

    def results(self, tally: LossTally | None, now: Instant) -> dict[str, Scalar]:
        """What normal damping, friction and films took since the start or in the window, J; what
        bristles would give back is not among it."""
        if tally is None:
            return {"": _lost(now)}
        return {"": self._window().if_reached(tally.at_end - tally.at_begin, now.time)}

    def units(self) -> dict[str, str]:
        """The energy is in J."""
        return {"": "J"}


class MeanPowerLost(AbstractReduction):
    """Mean power that normal damping, friction and films took; for `Settings(ledger=True)`.

    **Arguments:** `after`, `until`: s, the window of time over which the mean is taken, as for
    `Peak`.

    **Raises:** `ValueError` as `Peak`.

    >>> outputs = {"heating": cj.MeanPowerLost(after=0.5)}  # needs Settings(ledger=True)
    >>> outputs["heating"].units()
    {'': 'W'}
    """

    after: Instants = eqx.field(default=None, static=True, converter=optional_time)
    until: Instants = eqx.field(default=None, static=True, converter=optional_time)
    needs_ledger = True

    def __check_init__(self):
        self._window()

    def _window(self) -> Window:
        return Window(self.after, self.until)

    def start(self, now: Instant) -> tuple[Scalar, LossTally]:
        """The time of the start, s; and what is lost where the window begins and ends."""
        return now.time, LossTally(now.time, _lost(now), _lost(now))

    def update(self, tally: tuple[Scalar, LossTally], now: Instant) -> tuple[Scalar, LossTally]:
        """The losses up to the window's begin and end, as far as the step goes."""
        begin, losses = tally
        return begin, _lost_until(losses, now, self._window())

    def results(self, tally: tuple[Scalar, LossTally], now: Instant) -> dict[str, Scalar]:
        """The mean power, W, over the part of the window that was reached; NaN if none was."""
        begin, losses = tally
        window = self._window()
        duration = jnp.minimum(now.time, window.end) - jnp.maximum(begin, window.start)
        reached = duration > 0.0
        lost = losses.at_end - losses.at_begin
        return {"": jnp.where(reached, lost / jnp.where(reached, duration, 1.0), jnp.nan)}

    def units(self) -> dict[str, str]:
        """The power is in W."""
        return {"": "W"}


def _lost_until(tally: LossTally, now: Instant, window: Window) -> LossTally:
    """The losses up to the window's begin and end, as far as the step goes that ends now."""
    lost = _lost(now)
    at_edges = [
        jnp.where(now.time <= edge, lost, jnp.where(tally.time < edge, _lost(inside), known))
        for edge, inside, known in zip(
            (window.start, window.end),
            map(now.inside, window.places(tally.time, now.time)),
            (tally.at_begin, tally.at_end),
            strict=True,
        )
    ]
    return LossTally(now.time, *at_edges)


def _lost(now: Instant) -> Scalar:
    """What has been taken since the start, J."""
    lost: Scalar = 0.0
    for name in LOSSES:
        lost = add(lost, now.work.get(name, 0.0))
    if (held := now.bristle_energy) is not None:
        lost = lost - held
    return lost
