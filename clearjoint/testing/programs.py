"""Access the functions that a run evaluates in a step, to trace them, count and time them.

The state of a run between two attempts is a `Step`, a PyTree of arrays. Read and change it only by
the functions of this module.
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
    """The functions of one integration step of a run; `RunProgram.stepper` makes it.

    - `method`: solver, step size controller and events.
    - `system`: the mechanism, whose vectors are split into scalars.
    - `family`: the system as a function of parameters, if derivatives are integrated; else None.

    JAX can trace all functions, and `jax.vmap` can map them over steps.

    >>> program = testing.RunProgram.of(scene, state)
    >>> rates = program.stepper().rates(program.step)
    """

    method: Method
    system: System
    family: SystemFamily | None = None

    def integrated(self, step: Step) -> PyTree:
        """Return the variables of a step, or the pair of the variables and their tangents if
        derivatives are integrated."""
        return step.y if step.tangents is None else (step.y, step.tangents.y)

    def with_integrated(self, step: Step, numbers: PyTree) -> Step:
        """Return a copy of the step in which `numbers`, of the structure that `integrated` returns,
        replace the variables and tangents."""
        if step.tangents is None:
            return eqx.tree_at(lambda s: s.y, step, numbers)
        return eqx.tree_at(lambda s: (s.y, s.tangents.y), step, numbers)

    def rates(self, step: Step) -> PyTree:
        """Return the time derivatives of the numbers that `integrated` returns, in the same
        structure."""

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
        """Advance the variables by one step of the solver, without tangents, and without looking
        for events or deciding whether the step is accepted.

        **Arguments:** `step`: state of the run; `length`: of the solver's step, s.

        **Returns:** the step with new variables, and the sum of all components of the solver's
        error estimate.
        """
        t0, solver = step.t, self.method.solver
        y, error, _, state, _ = solver.step(
            self._term(step), t0, t0 + length, step.y, None, step.solver_state, False
        )
        after = eqx.tree_at(lambda s: (s.y, s.solver_state), step, (y, state))
        return after, sum(jax.tree.leaves(error), jnp.zeros_like(step.t))

    def attempt(self, step: Step) -> Step:
        """Return the state of the run after one attempt, with all that a run does in it: the step
        ends at an event if there is one, and it is accepted or rejected."""
        return attempt(self.method, self.system, step, jnp.asarray(jnp.inf), self.family).step

    def _term(self, step: Step) -> diffrax.ODETerm:
        """Return the equations of motion with the entry speeds of a step."""

        def rates(t: ArrayLike, y: Variables, args: object) -> Variables:
            del args
            rates = rates_of(self.system, y, step.entry_speeds, jnp.asarray(t))
            return jax.tree.map(lambda rate: jnp.asarray(rate, dtype=float), rates)

        return diffrax.ODETerm(rates)


class RunProgram(eqx.Module):
    """A run at its start; `RunProgram.of` makes it.

    - `scheme`: the integration method and the formulation of the equations of motion.
    - `folded_scene`: the scene with its folded constants.
    - `step`: state of the run before the first attempt.
    - `family`: the scene as a function of parameters, if derivatives are integrated; else None.

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
        - `settings`: settings of the run; by default those of `simulate`.
        - `time`: start of the run, s.
        - `parameters`: parameters, by name, by which derivatives are integrated; none by default.

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
        """Return the functions of one step of this run.

        Call this inside a function that JAX traces, with the program as an argument of that
        function, so that the numbers of the scene are traced too and not compiled as constants.
        """
        if self.family is not None:
            systems = SystemFamily(self.family, self.scheme.formulation)
            return Stepper(self.scheme.method, systems.system(), systems)
        return Stepper(self.scheme.method, self.scheme.unpacked(self.folded_scene))


def native_seconds() -> dict[str, float]:
    """Return the processor time, s, that this process has spent to make its native programs.

    **Returns:** seconds by stage: "tracing" by JAX, "lowering" of JAX's program to operations,
    "writing" of LLVM code, and "compiling" of this code.

    >>> sorted(testing.native_seconds())
    ['compiling', 'lowering', 'tracing', 'writing']
    """
    programs = [each for each in gc.get_objects() if isinstance(each, NativeProgram | LaneLoop)]
    stages = ("tracing", "lowering", "writing", "compiling")
    return {stage: sum(program.seconds[stage] for program in programs) for stage in stages}
