"""A ladder of scenes, each with one feature more than the one below."""

from collections.abc import Callable
from typing import Any

import clearjoint as cj
from studies.features.program import Program

FRICTION = cj.frictions.RegularisedCoulomb(0.1)
SHOULDERS = cj.EndPlay(1e-3, cj.laws.Hertz(1e8))
CLEARANCE = cj.Parameter(lambda scene: scene.joints["shoulder"].clearance)


def free_body() -> Program:
    """The pendulum's arm 2, falling and tumbling."""
    scene, _ = cj.mechanisms.double_pendulum()
    state = cj.State({"arm 2": cj.body_state((0.5, 0.0, 0.0), spin=(1.0, 3.0, 0.5))})
    return Program.of(cj.Scene({"arm 2": scene.bodies["arm 2"]}, gravity=scene.gravity), state)


def pendulum() -> Program:
    """Arm 2 on an ideal shoulder."""
    scene, state = cj.mechanisms.double_pendulum(None)
    arm, joints = {"arm 2": scene.bodies["arm 2"]}, {"shoulder": scene.joints["shoulder"]}
    state = cj.State({"arm 2": state.bodies["arm 2"]})
    return Program.of(cj.Scene(arm, joints, gravity=scene.gravity), state)


def _double(*arguments: Any, **options: Any) -> Callable[[], Program]:
    return lambda: Program.of(*cj.mechanisms.double_pendulum(*arguments, **options))


def _rough(
    settings: cj.Settings | None = None, parameters: dict[str, cj.Parameter] | None = None
) -> Program:
    """The double pendulum with all its features."""
    scene, state = cj.mechanisms.double_pendulum(friction=FRICTION, axial=SHOULDERS)
    return Program.of(scene, state, settings, parameters)


LADDER: dict[str, Callable[[], Program]] = {
    "free body": free_body,
    "pendulum": pendulum,
    "+ ideal joint": _double(None),
    "+ clearance": _double(),
    "+ friction": _double(friction=FRICTION),
    "+ end play": _double(friction=FRICTION, axial=SHOULDERS),
    "+ energy ledger": lambda: _rough(cj.Settings(ledger=True)),
    "+ one sensitivity, no ledger": lambda: _rough(parameters={"clearance": CLEARANCE}),
}
"""By name, each with one feature more than the one before."""
