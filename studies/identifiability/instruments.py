"""Five kinds of sensors on the double pendulum, and the bounds that they give."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint import plot
from clearjoint.quantities import (
    Acceleration,
    Component,
    ContactForce,
    JournalOffset,
    Position,
    Reaction,
)

SHOULDER, ELBOW, ARMS, BASES = "shoulder", "elbow", ("arm 2", "arm 3"), ("V", "W")
SAMPLES = 1000
ACROSS: tuple[Component, ...] = ("x", "y")
ALL: tuple[Component, ...] = ("x", "y", "z")
LENGTHS = (0.05, 0.1)
"""Lengths of the records, s."""
PARAMETERS = {
    "stiffness": cj.Parameter(lambda s: s.joints[SHOULDER].law.stiffness.young_modulus, cj.Log()),
    "restitution": cj.Parameter(lambda s: s.joints[SHOULDER].law.restitution),
    "clearance": cj.Parameter(lambda s: s.joints[SHOULDER].clearance, cj.Log()),
}


@dataclass(frozen=True)
class Instrument:
    """A sensor and its known bounds.

    `noise`: one standard deviation in the channels' SI unit. `known`: by length of the record,
    standard deviations of log K, e and log c as printed, "" if not identifiable.
    """

    title: str
    channels: tuple[Callable[[Any], Any], ...]
    noise: float
    known: tuple[tuple[str, str, str], tuple[str, str, str]]


INSTRUMENTS = {
    "camera": Instrument(
        "arms' positions, 75 µm",
        tuple(Position(arm, k) for arm in ARMS for k in ALL),
        75e-6,
        (("", "0.009", "0.24"), ("0.06", "0.003", "0.008")),
    ),
    "probes": Instrument(
        "journal at both bases, 5 µm",
        tuple(JournalOffset(SHOULDER, component=k, base=base) for base in BASES for k in ACROSS),
        5e-6,
        (("0.47", "1.5e-4", "0.004"), ("0.0007", "6e-5", "0.00018")),
    ),
    "accelerometers": Instrument(
        "arms' accelerations, 5 m/s²",
        tuple(Acceleration(arm, k) for arm in ARMS for k in ALL),
        5.0,
        (("0.011", "4e-5", "0.00012"), ("0.0004", "2e-5", "0.00005")),
    ),
    "hinge": Instrument(
        "hinge reaction, 7 N",
        tuple(Reaction(ELBOW, ARMS[1], k) for k in ALL),
        7.0,
        (("0.012", "4e-5", "0.00012"), ("0.0003", "2e-5", "0.00005")),
    ),
    "contacts": Instrument(
        "contact forces, 15 N",
        tuple(ContactForce(SHOULDER, base) for base in BASES),
        15.0,
        (("0.009", "3e-5", "0.00009"), ("0.0002", "1e-5", "0.00003")),
    ),
}


def report(length: float, samples: int = SAMPLES) -> cj.results.Identifiability:
    """Return the bounds of all instruments for records of a length in s."""
    times = length * np.arange(1, samples + 1) / samples
    sensors = {
        name: cj.Sensor(instrument.channels, times, instrument.noise)
        for name, instrument in INSTRUMENTS.items()
    }
    return cj.identifiability(*cj.mechanisms.double_pendulum(), PARAMETERS, sensors)


def table(found: cj.results.Identifiability, column: int) -> str:
    """Return the table of bounds and known bounds."""
    rows = [("sensor", *(f"{name}: found, known" for name in PARAMETERS)), ("---",) * 4]
    for name, instrument in INSTRUMENTS.items():
        one = found.of(name)
        cells = []
        for parameter, deviation, known in zip(
            one.names, one.deviations, instrument.known[column], strict=True
        ):
            shown = f"{deviation:.2g}" if one.identifiable[parameter] else "not identifiable"
            cells.append(f"{shown}, {known or 'not identifiable'}")
        rows.append((instrument.title, *cells))
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def figure(found: cj.results.Identifiability) -> Figure:
    """Draw the bounds of all instruments over the length of the record."""
    drawn = Figure(figsize=(13.0, 3.8), layout="constrained")
    panels = drawn.subplots(1, len(INSTRUMENTS), sharey=True)
    for panel, (name, instrument) in zip(panels, INSTRUMENTS.items(), strict=True):
        plot.record_length(found.of(name), axes=panel)
        panel.set_title(instrument.title, fontsize="medium")
        if panel is not panels[0]:
            panel.set_ylabel("")
            panel.get_legend().remove()
    panels[0].set_ylim(1e-6, 100.0)
    return drawn
