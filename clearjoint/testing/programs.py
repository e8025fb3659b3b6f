"""Functions that a run evaluates at a step, to trace, to count and to time.

A step is a PyTree of arrays that a run carries from one attempt to the next; only the documented
functions should be used of it.
"""

import gc
from collections.abc import Mapping
from dataclasses import dataclass

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import ArrayLike, PyTree

from ..dynamics.contact_forces import EntrySpeeds
from ..dynamics.system import System
from ..math.vectors import ConstantFolded, Scalar, fold_constants
from ..model.bodies import State
from ..model.scene import Scene
from ..native.functions import NativeProgram
from ..native.lanes import LaneLoop
from ..parametrisation.parameter import Parameter, coordinates_of
from ..parametrisation.parametrised_scene import AbstractFamily, parametrised
from ..simulation.run.derivative_runs import derivative_scheme
from ..simulation.run.run_checks import check_precision, check_start
from ..simulation.run.run_ends import begin_run
from ..simulation.step import presets
from ..simulation.step.method import Scheme
from ..simulation.step.settings import Settings, settings_or
from ..simulation.step.step_state import Method, Step, Variables
from ..simulation.step.stepping import attempt
from ..simulation.step.systems import SystemFamily
from ..simulation.step.trial_step import rates_of
from ..simulation.step.variational import start_with_tangents

FIRST_STEP, END = 1e-6, 1e9
"""Of the run that a program is taken from, s."""


@dataclass(frozen=True)
class Stepper:
    """A method at work on a system: what happens at a step, as functions of the step.

    With a `family`, derivatives go along. All functions can be traced, and mapped over steps.

    >>> program = testing.RunProgram.of(scene, state)
    >>> rates = program.stepper().rates(program.step)
    """

    method: Method
    system: System
    family: SystemFamily | None = None

    def integrated(self, step: Step) -> PyTree:
        """The numbers that are integrated; derivatives among them if there are any."""
        return step.y if step.tangents is None else (step.y, step.tangents.y)

    def with_integrated(self, step: Step, numbers: PyTree) -> Step:
        """The step with other numbers to integrate."""
        if step.tangents is None:
            return eqx.tree_at(lambda s: s.y, step, numbers)
        return eqx.tree_at(lambda s: (s.y, s.tangents.y), step, numbers)

    def rates(self, step: Step) -> PyTree:
        """The right-hand side: rates of what is integrated."""

        def rates(
            system: System, y: Variables, entry_speeds: EntrySpeeds
        ) -> tuple[Variables, None]:
            return rates_of(system, y, entry_speeds, step.t), None

        if self.family is None:
            return rates(self.system, step.y, step.entry_speeds)[0]
        assert step.tangents is not None
        along = step.tangents.y, step.tangents.entry_speeds
        value, _, derivatives = self.family.pushed(rates, (step.y, step.entry_speeds), along)
        return value, derivatives

    def solver_step(self, step: Step, length: float) -> tuple[Step, Scalar]:
        """A step of the solver of a length in s, judged by nothing and without derivatives; and the
        sum of its errors."""
        y, error, state = self._solved(step, length)
        after = eqx.tree_at(lambda s: (s.y, s.solver_state), step, (y, state))
        return after, sum(jax.tree.leaves(error), jnp.zeros_like(step.t))

    def controlled_step(self, step: Step, length: float) -> tuple[Step, jax.Array]:
        """The same with the controller's judgement; and the time it chooses next, s."""
        y, error, state = self._solved(step, length)
        controller = self.method.controller.wrap(1)
        order = self.method.solver.error_order(self._term(step))
        assert order is not None
        t0, past = step.t, step.proposal.controller_state
        _, _, t_next, _, past, _ = controller.adapt_step_size(
            t0, t0 + length, step.y, y, None, error, order, past
        )
        fields = (y, state, past)
        after = eqx.tree_at(
            lambda s: (s.y, s.solver_state, s.proposal.controller_state), step, fields
        )
        return after, jnp.asarray(t_next)

    def attempt(self, step: Step) -> Step:
        """A step as a run tries it, landing, memory and acceptance included."""
        return attempt(self.method, self.system, step, jnp.asarray(jnp.inf), self.family).step

    def _solved(self, step: Step, length: float) -> tuple[Variables, PyTree, PyTree]:
        t0, solver = step.t, self.method.solver
        y, error, _, state, _ = solver.step(
            self._term(step), t0, t0 + length, step.y, None, step.solver_state, False
        )
        return y, error, state

    def _term(self, step: Step) -> diffrax.ODETerm:
        """The equations of motion with the memory of a step."""

        def rates(t: ArrayLike, y: Variables, args: object) -> Variables:
            del args
            rates = rates_of(self.system, y, step.entry_speeds, jnp.asarray(t))
            return jax.tree.map(lambda rate: jnp.asarray(rate, dtype=float), rates)

        return diffrax.ODETerm(rates)


class RunProgram(eqx.Module):
    """A run before its first `step`.

    >>> program = testing.RunProgram.of(scene, state)
    >>> later = program.stepper().attempt(program.step)
    >>> float(later.t) > 0.0
    True
    """

    scheme: Scheme
    folded_scene: ConstantFolded
    step: Step
    family: AbstractFamily | None

    @staticmethod
    def of(
        scene: Scene,
        state: State,
        settings: Settings | None = None,
        *,
        time: float = 0.0,
        parameters: Mapping[str, Parameter] | None = None,
    ) -> "RunProgram":
        """The run of a scene from a state.

        **Arguments:**

        - `settings`: `simulate`'s default unless given.
        - `time`: of the start, s.
        - `parameters`: what derivatives are integrated along, if any.

        **Raises:** `ValueError` for a scene, state or setting that no run can use.
        """
        settings = settings_or(settings, presets.default)
        check_precision(settings.allow_float32)
        folded_scene = fold_constants(scene)
        span = (jnp.asarray(number) for number in (time, END, FIRST_STEP))
        if parameters is None:
            redundant = check_start(scene, state, time, settings.coordinates)
            scheme = Scheme.of(settings, bool(redundant))
            step = begin_run(scheme.method, scheme.unpacked(folded_scene), state, *span)
            return RunProgram(scheme, folded_scene, step, None)
        scheme = derivative_scheme(scene, state, settings, time)
        values = jnp.asarray(coordinates_of(scene, state, parameters))
        family = parametrised(scene, state, parameters, values)
        systems = SystemFamily(family, scheme.formulation)
        return RunProgram(
            scheme, folded_scene, start_with_tangents(scheme.method, systems, *span), family
        )

    def stepper(self) -> Stepper:
        """What happens at a step. Inside a traced function, the scene's numbers are those given to
        it."""
        if self.family is not None:
            systems = SystemFamily(self.family, self.scheme.formulation)
            return Stepper(self.scheme.method, systems.system(), systems)
        return Stepper(self.scheme.method, self.scheme.unpacked(self.folded_scene))


def native_seconds() -> dict[str, float]:
    """Processor time, s, that the native programs of this process took to make, by part: "tracing"
    by JAX, "lowering" to operations, "writing" of LLVM's text, "compiling".

    >>> sorted(testing.native_seconds())
    ['compiling', 'lowering', 'tracing', 'writing']
    """
    made = [each for each in gc.get_objects() if isinstance(each, NativeProgram | LaneLoop)]
    parts = ("tracing", "lowering", "writing", "compiling")
    return {part: sum(each.seconds[part] for each in made) for part in parts}
