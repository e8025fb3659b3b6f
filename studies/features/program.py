"""A scene's right-hand side and attempted step as programs: to count, to print, and to time."""

import re
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

import clearjoint as cj
from clearjoint.testing import RunProgram, Stepper
from studies.common.loops import microseconds, right_hand_sides, solver_steps, tried_steps
from studies.common.operations import jaxpr_operations

SPREAD = 1e-9
"""By which lanes differ, relative."""


@dataclass(frozen=True)
class Program:
    """A scene at its start, ready to step at rtol 1e-6; `inside` makes the context in which the
    program is traced."""

    run: RunProgram
    inside: Callable[[], AbstractContextManager[None]] = nullcontext

    @staticmethod
    def of(
        scene: cj.Scene,
        state: cj.State,
        settings: cj.Settings | None = None,
        parameters: dict[str, cj.Parameter] | None = None,
    ) -> "Program":
        """The program of a scene."""
        return Program(RunProgram.of(scene, state, settings, parameters=parameters))

    def _jaxprs(self) -> list[Any]:
        """Of a right-hand side and an attempted step; the scene's own numbers are constants, and
        what is computed of them alone is no part of it."""
        with self.inside():
            return [
                jax.make_jaxpr(lambda step, of=part: of(self.run.stepper(), step))(self.run.step)
                for part in (Stepper.rates, Stepper.attempt)
            ]

    def text(self) -> str:
        """Both, as JAX prints them, less addresses in memory."""
        return "\n".join(re.sub(r"0x[0-9a-f]+", "", str(jaxpr)) for jaxpr in self._jaxprs())

    def operations(self) -> tuple[int, int]:
        """Arithmetic operations of a right-hand side and an attempted step."""
        here, there = (jaxpr_operations(jaxpr.jaxpr) for jaxpr in self._jaxprs())
        return here, there

    def equations(self) -> tuple[int, int]:
        """Equations of both, arithmetic or not, inner ones included."""
        here, there = (_equations(jaxpr.jaxpr) for jaxpr in self._jaxprs())
        return here, there

    @property
    def variables(self) -> int:
        """Numbers that are integrated, derivatives included."""
        leaves = jax.tree.leaves(self.run.stepper().integrated(self.run.step))
        return sum(int(jnp.size(leaf)) for leaf in leaves)

    def loops(self, lanes: int, turns: int, solver: bool = False) -> list[Callable[[], float]]:
        """Functions that time a right-hand side, the solver's step (if asked for) and an attempt.

        In µs a lane, in native loops of so many turns. The first call compiles.
        """
        steps = self.run.step
        if lanes > 1:
            steps = jax.tree.map(lambda leaf: jnp.stack([leaf] * lanes), steps)
            spread = 1.0 + SPREAD * jnp.arange(lanes)
            stepper = self.run.stepper()
            apart = jax.tree.map(lambda leaf: leaf * spread, stepper.integrated(steps))
            steps = stepper.with_integrated(steps, apart)
        parts = [right_hand_sides, *([solver_steps] if solver else []), tried_steps]

        def timed(part: Callable[..., Any]) -> Callable[[], float]:
            @eqx.filter_jit
            def loop(run: RunProgram, steps: Any, count: Any) -> Any:
                def one(step: Any) -> Any:
                    return jax.tree.leaves(part(run.stepper(), step, count))

                with self.inside():
                    return one(steps) if lanes == 1 else jax.vmap(one)(steps)

            count = jnp.asarray(turns // lanes)
            return lambda: microseconds(turns // lanes * lanes, loop, self.run, steps, count)

        return [timed(part) for part in parts]


def _equations(jaxpr: Any) -> int:
    total = 0
    for equation in jaxpr.eqns:
        parts = jax.tree.leaves(list(equation.params.values()), is_leaf=_is_jaxpr)
        total += 1 + sum(_equations(part.jaxpr) for part in parts if _is_jaxpr(part))
    return total


def _is_jaxpr(part: Any) -> bool:
    return hasattr(part, "jaxpr")
