"""A ladder of scenes, each with one feature more than the one below, and each feature's code."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

import clearjoint as cj
from clearjoint import branches, dynamics, inertia, stepping
from clearjoint.family import AbstractFamily
from clearjoint.impacts import Landing
from clearjoint.joints import axial, clearance, freedoms
from studies.required.program import Program

FRICTION = cj.RegularisedCoulomb(0.1)
SHOULDERS = cj.EndPlay(1e-3, cj.Hertz(1e8))
CLEARANCE = cj.Parameter(lambda scene: scene.joints["shoulder"].clearance)


@dataclass(frozen=True)
class Rung:
    """A scene with one feature more than that of the rung below, and where the feature's code is:
    owners and names of functions that nothing below may call."""

    name: str
    make: Callable[[], Program]
    code: tuple[tuple[Any, str], ...]


def free_body() -> Program:
    """The pendulum's arm 2, falling and tumbling."""
    scene, _ = cj.double_pendulum()
    state = cj.State({"arm 2": cj.body_state((0.5, 0.0, 0.0), spin=(1.0, 3.0, 0.5))})
    return Program.of(cj.Scene({"arm 2": scene.bodies["arm 2"]}, gravity=scene.gravity), state)


def pendulum() -> Program:
    """Arm 2 on an ideal shoulder."""
    scene, state = cj.double_pendulum(None)
    arm, joints = {"arm 2": scene.bodies["arm 2"]}, {"shoulder": scene.joints["shoulder"]}
    state = cj.State({"arm 2": state.bodies["arm 2"]})
    return Program.of(cj.Scene(arm, joints, gravity=scene.gravity), state)


def _double(*arguments: Any, **options: Any) -> Callable[[], Program]:
    return lambda: Program.of(*cj.double_pendulum(*arguments, **options))


def _rough(ledger: bool = False, parameters: dict[str, cj.Parameter] | None = None) -> Program:
    """The double pendulum with all its features."""
    scene, state = cj.double_pendulum(friction=FRICTION, axial=SHOULDERS)
    return Program.of(scene, state, ledger, parameters)


LADDER = (
    Rung("free body", free_body, ()),
    Rung(
        "pendulum",
        pendulum,
        ((freedoms.Hinge, "rotation"), (freedoms.Hinge, "columns"), (branches, "jointed_link")),
    ),
    Rung("+ ideal joint", _double(None), ((inertia.Inertia, "without"),)),
    Rung(
        "+ clearance",
        _double(),
        (
            (clearance.ClearanceJoint, "contacts"),
            (dynamics, "contact_normal_force"),
            (Landing, "due"),
            (Landing, "retry"),
            (stepping, "updated_memory"),
            (stepping, "second_rates"),
        ),
    ),
    Rung(
        "+ friction",
        _double(friction=FRICTION),
        ((cj.RegularisedCoulomb, "force"), (clearance, "slip_velocity")),
    ),
    Rung(
        "+ end play",
        _double(friction=FRICTION, axial=SHOULDERS),
        ((axial.EndPlay, "shoulder_gap"),),
    ),
    Rung("+ energy ledger", lambda: _rough(ledger=True), ((dynamics, "ledger_powers"),)),
    Rung(
        "+ one sensitivity, no ledger",
        lambda: _rough(ledger=False, parameters={"clearance": CLEARANCE}),
        ((AbstractFamily, "pushed"), (stepping, "_tangents_after")),
    ),
)
"""The last rung has no ledger: runs with derivatives keep none."""


@contextmanager
def without(rungs: Sequence[Rung]) -> Iterator[None]:
    """Inside, the code of the rungs' features is missing."""
    with ExitStack() as patches:
        for owner, name in (place for rung in rungs for place in rung.code):
            patches.enter_context(patch.object(owner, name, _missing(name)))
        yield


def _missing(name: str) -> Callable[..., Any]:
    def function(*_: Any, **__: Any) -> Any:
        raise AssertionError(f"{name} is called by a scene that lacks the feature")

    return function


def unchanged(place: int) -> bool:
    """Whether a rung has the same program, word by word, where the code of all rungs above it is
    missing."""
    rung = LADDER[place]
    text = rung.make().text()
    with without(LADDER[place + 1 :]):
        try:
            return rung.make().text() == text
        except AssertionError:
            return False
