"""Impossible numbers, each refused with the argument and a remedy."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import clearjoint as cj
from studies.extremes.cases import BASE
from studies.extremes.families import FAMILIES


@dataclass(frozen=True)
class Refusal:
    """Description of an attempt, and its error message, or "" if there was none."""

    attempt: str
    message: str


def refusals() -> list[Refusal]:
    """Return the results of all attempts."""
    return [Refusal(name, _message(attempt)) for name, attempt in ATTEMPTS.items()]


def _message(attempt: Callable[[], object]) -> str:
    try:
        attempt()
    except ValueError as error:
        return str(error)
    return ""


def _joint(clearance: float = 1e-4, journal_length: float = 0.02) -> cj.ClearanceJoint:
    return cj.ClearanceJoint(
        "ground",
        "arm",
        bearing_radius=10e-3,
        clearance=clearance,
        journal_length=journal_length,
        law=cj.laws.Hertz(stiffness=_stiffness()),
    )


def _stiffness(value: float = 1e10) -> cj.laws.GivenStiffness:
    return cj.laws.GivenStiffness(value)


def _run(end_time: float) -> object:
    trial = FAMILIES["thrown journal"].trial(BASE)
    return cj.simulate(trial.scene, trial.state, end_time)


def _run_with_entry_speed() -> object:
    trial = FAMILIES["thrown journal"].trial(BASE)
    entry_speeds = {"pin": {"V": np.nan, "W": 0.0}}
    return cj.simulate(trial.scene, cj.State(trial.state.bodies, entry_speeds), 1e-3)


def _run_from(**changes: object) -> object:
    trial = FAMILIES["thrown journal"].trial(BASE)
    parts = {name: getattr(trial.state.bodies["journal"], name) for name in PARTS} | changes
    state = cj.State({"journal": cj.BodyState(**parts)})  # pyright: ignore
    return cj.simulate(trial.scene, state, 1e-3)


PARTS = ("position", "orientation", "velocity", "spin")
NAN = np.full(3, np.nan)

ATTEMPTS: dict[str, Callable[[], object]] = {
    "clearance 0": lambda: _joint(clearance=0.0),
    "clearance -1 nm": lambda: _joint(clearance=-1e-9),
    "clearance as large as the bearing": lambda: _joint(clearance=10e-3),
    "clearance NaN": lambda: _joint(clearance=np.nan),
    "journal as large as its bearing": lambda: cj.ClearanceJoint(
        "ground",
        "arm",
        bearing_radius=1e-2,
        journal_radius=1e-2,
        journal_length=0.02,
        law=cj.laws.Hertz(stiffness=_stiffness()),
    ),
    "journal's length 0": lambda: _joint(journal_length=0.0),
    "stiffness 0": lambda: cj.laws.Hertz(stiffness=_stiffness(0.0)),
    "stiffness infinite": lambda: cj.laws.Hertz(stiffness=_stiffness(np.inf)),
    "restitution 1.1": lambda: cj.laws.LankaraniNikravesh(restitution=1.1, stiffness=_stiffness()),
    "restitution -0.1": lambda: cj.laws.HuntCrossley(restitution=-0.1, stiffness=_stiffness()),
    "Flores 2011 at restitution 0": lambda: cj.laws.Flores2011(
        restitution=0.0, stiffness=_stiffness()
    ),
    "floor of the entry speed 0": lambda: cj.laws.HuntCrossley(
        restitution=0.5, stiffness=_stiffness(), entry_speed_floor=0.0
    ),
    "friction -0.1": lambda: cj.frictions.RegularisedCoulomb(-0.1),
    "friction's regularisation 0": lambda: cj.frictions.RegularisedCoulomb(0.1, 0.0),
    "mass 0": lambda: cj.Body(0.0, (1, 1, 1)),
    "inertia of no body": lambda: cj.Body(1.0, (1, 1, 3)),
    "Euler parameters of norm 2": lambda: cj.body_state((0, 0, 0), (2, 0, 0, 0)),
    "position NaN": lambda: _run_from(position=NAN),
    "speed infinite": lambda: _run_from(velocity=np.array([np.inf, 0, 0])),
    "Euler parameters 0, unchecked state": lambda: _run_from(orientation=np.zeros(4)),
    "entry speed NaN": _run_with_entry_speed,
    "end before the start": lambda: _run(end_time=-1.0),
    "end time NaN": lambda: _run(end_time=np.nan),
    "tolerance NaN": lambda: cj.Settings(rtol=np.nan),
    "no tolerance at all": lambda: cj.Settings(rtol=0.0, atol=0.0),
    "landing tolerance 0": lambda: cj.Settings(landing_tolerance=0.0),
}
