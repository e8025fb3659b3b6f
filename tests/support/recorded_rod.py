"""Derivatives of the dropped rod with all that can be recorded beside them: one program for all."""

import numpy as np

import clearjoint as cj
from tests.support.dropped_rod import dropped_rod

END = 2.0**-5
"""s: with its eighths a sum of few powers of two, exact wherever a run starts."""
EIGHTHS = END * np.arange(9) / 8
SELDOM = EIGHTHS[::4]
CLEARANCE = cj.Parameter(lambda s: s.joints["pin"].clearance, cj.Log())
HEIGHT, ENTRY = cj.quantities.Position("rod", "y"), cj.quantities.EntrySpeed("pin", "V")


def clock(now):
    """The time, s."""
    return now.time


def _approach(now):
    return -now.contact_gaps["pin"]["V"].rate


def deepest(start: float = 0.0) -> dict[str, cj.Section]:
    """Where the journal is deepest in the wall, without the first time."""
    return {"deepest": cj.Section(_approach, {"height": (HEIGHT, "m")}, 2, after=start + 0.02)}


def everything(start: float = 0.0) -> cj.Saving:
    """States and impacts."""
    return cj.Saving(start + EIGHTHS, impacts=True)


def recorded_rod(start: float = 0.0) -> cj.results.Sensitivities:
    """A run across the first impacts from a time on, s."""
    return cj.sensitivities(
        *dropped_rod(),
        start + END,
        {"clearance": CLEARANCE},
        {"height": HEIGHT, "entry": ENTRY, "time": clock, **deepest(start)},
        start + SELDOM,
        start_time=start,
        save=everything(start),
    )
