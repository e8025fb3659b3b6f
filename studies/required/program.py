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
from clearjoint.dynamics import Formulation, state_rates
from clearjoint.estimands import coordinates_of, parametrised
from clearjoint.family import AbstractFamily
from clearjoint.simulate import make_method
from clearjoint.stepping import attempt, start
from clearjoint.steps import Method, Step, Variables
from clearjoint.tangents import start_with_tangents
from clearjoint.vectors import Structured, structured, unpack
from studies.benchmarks.operations import jaxpr_operations
from studies.benchmarks.step_profile import (
    microseconds,
    repeated,
    right_hand_sides,
    solver_steps,
    tried_steps,
)

RTOL, FIRST_STEP, END = 1e-6, 1e-6, 1e9
SMALL = 1e-9
"""s, by which right-hand sides in a loop move on."""
SPREAD = 1e-9
"""By which lanes differ, relative."""


@dataclass(frozen=True)
class Program:
    """A scene at its start, ready to step at rtol 1e-6.

    `family` says along what derivatives are integrated with it, if any are; `inside` makes the
    context in which the program is traced.
    """

    method: Method
    form: Structured
    step: Step
    family: AbstractFamily | None
    inside: Callable[[], AbstractContextManager[None]] = nullcontext

    @staticmethod
    def of(
        scene: cj.Scene,
        state: cj.State,
        ledger: bool = False,
        parameters: dict[str, cj.Parameter] | None = None,
    ) -> "Program":
        """The program of a scene."""
        method = make_method(None, None, Formulation(ledger=ledger), 1e-12, RTOL, None)
        form, family = structured(scene), None
        t0, t_end, first = (jnp.asarray(number) for number in (0.0, END, FIRST_STEP))
        if parameters is None:
            motion = method.formulation.coordinates.encode(unpack(form), unpack(state.bodies))
            step = start(method, unpack(form), t0, t_end, first, Variables(motion, {}), {})
        else:
            values = jnp.asarray(coordinates_of(scene, state, parameters))
            family = parametrised(scene, state, parameters, values)
            step = start_with_tangents(method, family, t0, t_end, first)
        return Program(method, form, step, family)

    def _rates(self, step: Step, form: Structured) -> Any:
        """The right-hand side, and its derivatives if there are parameters."""

        def rates(scene: cj.Scene, y: Variables, memory: Any) -> tuple[Variables, None]:
            formulation = self.method.formulation
            return Variables(*state_rates(scene, formulation, y.motion, memory, step.t)), None

        if self.family is None:
            return rates(unpack(form), step.y, step.memory)[0]
        assert step.tangents is not None
        along = step.tangents.y, step.tangents.memory
        value, _, derivatives = self.family.pushed(rates, (step.y, step.memory), along)
        return value, derivatives

    def _attempt(self, step: Step, form: Structured) -> Step:
        scene = unpack(form) if self.family is None else self.family.scene(self.family.values)
        return attempt(self.method, scene, step, jnp.asarray(END), self.family).step

    def _jaxprs(self) -> list[Any]:
        """Of a right-hand side and an attempted step; the scene's own numbers are constants, and
        what is computed of them alone is no part of it."""
        parts = (self._rates, self._attempt)
        with self.inside():
            return [
                jax.make_jaxpr(lambda step, of=part: of(step, self.form))(self.step)
                for part in parts
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
        tangents = () if self.step.tangents is None else self.step.tangents.y
        leaves = jax.tree.leaves((self.step.y, tangents))
        return sum(int(jnp.size(leaf)) for leaf in leaves)

    def loops(self, lanes: int, turns: int, solver: bool = False) -> list[Callable[[], float]]:
        """Functions that time a right-hand side, the solver's step (if asked for) and an attempt.

        In µs a lane, in native loops of so many turns. The first call compiles.
        """
        steps = self.step
        if lanes > 1:
            steps = jax.tree.map(lambda leaf: jnp.stack([leaf] * lanes), self.step)
            spread = 1.0 + SPREAD * jnp.arange(lanes)
            apart = jax.tree.map(lambda leaf: leaf * spread, steps.y.motion)
            steps = eqx.tree_at(lambda step: step.y.motion, steps, apart)
        parts = [self._turns_of_rates, *([self._turns_of_solver] if solver else []), self._turns]

        def timed(part: Callable[..., Any]) -> Callable[[], float]:
            @eqx.filter_jit
            def loop(steps: Step, form: Structured, count: Any) -> Any:
                def one(step: Step) -> Any:
                    return jax.tree.leaves(part(step, form, count))

                with self.inside():
                    return one(steps) if lanes == 1 else jax.vmap(one)(steps)

            count = jnp.asarray(turns // lanes)
            return lambda: microseconds(turns // lanes * lanes, loop, steps, self.form, count)

        return [timed(part) for part in parts]

    def _turns_of_rates(self, step: Step, form: Structured, turns: Any) -> Any:
        if self.family is None:
            return right_hand_sides(self.method, unpack(form), step, turns)

        def turn(y: Any, along: Any) -> tuple[Any, Any]:
            there = eqx.tree_at(lambda s: (s.y, s.tangents.y), step, (y, along))
            rates = self._rates(there, form)
            return jax.tree.map(lambda value, rate: value + SMALL * rate, (y, along), rates)

        assert step.tangents is not None
        return repeated(turn, turns, step.y, step.tangents.y)

    def _turns_of_solver(self, step: Step, form: Structured, turns: Any) -> Any:
        return solver_steps(self.method, unpack(form), step, turns)

    def _turns(self, step: Step, form: Structured, turns: Any) -> Any:
        if self.family is None:
            return tried_steps(self.method, unpack(form), step, turns)
        return repeated(lambda step: (self._attempt(step, form),), turns, step)


def _equations(jaxpr: Any) -> int:
    total = 0
    for equation in jaxpr.eqns:
        parts = jax.tree.leaves(list(equation.params.values()), is_leaf=_is_jaxpr)
        total += 1 + sum(_equations(part.jaxpr) for part in parts if _is_jaxpr(part))
    return total


def _is_jaxpr(part: Any) -> bool:
    return hasattr(part, "jaxpr")
