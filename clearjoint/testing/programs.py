"""The functions that a run evaluates in a step, to be traced, counted and timed.

A step is a PyTree of arrays that a run carries from one attempt to the next. Use only the functions
documented here to access it.
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
"""First step and end time of the run, s."""


@dataclass(frozen=True)
class Stepper:
    """An integration method applied to a system, as functions of the step.

    - `method`: solver, controller and events.
    - `system`: the mechanism in scalar form.
    - `family`: the parametrised system if derivatives are integrated, otherwise ``None``.

    All functions can be traced and mapped over steps.

    >>> program = testing.RunProgram.of(scene, state)
    >>> rates = program.stepper().rates(program.step)
    """

    method: Method
    system: System
    family: SystemFamily | None = None

    def integrated(self, step: Step) -> PyTree:
        """Return the integrated numbers, including derivatives if there are any."""
        return step.y if step.tangents is None else (step.y, step.tangents.y)

    def with_integrated(self, step: Step, numbers: PyTree) -> Step:
        """Return the step with other integrated numbers."""
        if step.tangents is None:
            return eqx.tree_at(lambda s: s.y, step, numbers)
        return eqx.tree_at(lambda s: (s.y, s.tangents.y), step, numbers)

    def rates(self, step: Step) -> PyTree:
        """Return the right-hand side: the rates of the integrated numbers."""

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
        """Return the step after one solver step of a length in s, and the sum of its errors.

        The step is not checked for events or accepted, and derivatives are not integrated.
        """
        t0, solver = step.t, self.method.solver
        y, error, _, state, _ = solver.step(
            self._term(step), t0, t0 + length, step.y, None, step.solver_state, False
        )
        after = eqx.tree_at(lambda s: (s.y, s.solver_state), step, (y, state))
        return after, sum(jax.tree.leaves(error), jnp.zeros_like(step.t))

    def attempt(self, step: Step) -> Step:
        """Return the step after one attempt of a run, including events, entry speeds and
        acceptance."""
        return attempt(self.method, self.system, step, jnp.asarray(jnp.inf), self.family).step

    def _term(self, step: Step) -> diffrax.ODETerm:
        """Return the equations of motion with the entry speeds of a step."""

        def rates(t: ArrayLike, y: Variables, args: object) -> Variables:
            del args
            rates = rates_of(self.system, y, step.entry_speeds, jnp.asarray(t))
            return jax.tree.map(lambda rate: jnp.asarray(rate, dtype=float), rates)

        return diffrax.ODETerm(rates)


class RunProgram(eqx.Module):
    """A run at its start, with the data of its first `step`.

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
        """Return the run of a scene from a state.

        **Arguments:**

        - `scene`, `state`: the mechanism and its initial state.
        - `settings`: the default of `simulate` unless given.
        - `time`: of the start, s.
        - `parameters`: for which derivatives are integrated; none by default.

        **Raises:** `ValueError` if a run can't use the scene, the state or the settings.
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
        """Return the step functions.

        In a traced function that takes the program as an argument, they use its traced numbers.
        """
        if self.family is not None:
            systems = SystemFamily(self.family, self.scheme.formulation)
            return Stepper(self.scheme.method, systems.system(), systems)
        return Stepper(self.scheme.method, self.scheme.unpacked(self.folded_scene))


def native_seconds() -> dict[str, float]:
    """Return the processor time, s, for making the native programs of this process, by stage.

    The stages are "tracing" by JAX, "lowering" to operations, "writing" of LLVM code, and
    "compiling".

    >>> sorted(testing.native_seconds())
    ['compiling', 'lowering', 'tracing', 'writing']
    """
    programs = [each for each in gc.get_objects() if isinstance(each, NativeProgram | LaneLoop)]
    stages = ("tracing", "lowering", "writing", "compiling")
    return {stage: sum(program.seconds[stage] for program in programs) for stage in stages}
