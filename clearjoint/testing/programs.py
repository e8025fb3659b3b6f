"""What runs, sweeps and sensitivities compile, as functions to trace, to count and to time.

Steps and lanes are PyTrees of arrays, of which nothing but the documented functions should be used:
a step is what a run carries from one to the next, a lane the same in a sweep.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Concatenate, ParamSpec
from unittest.mock import patch

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, PyTree

from ..dynamics.contact_forces import Memory
from ..dynamics.system import System
from ..math.vectors import Scalar, Structured, structured
from ..model.bodies import State
from ..model.scene import Scene
from ..parametrisation.parameter import Parameter, coordinates_of
from ..parametrisation.parametrised_scene import AbstractFamily, parametrised
from ..quantities.base import Quantity
from ..simulation import presets
from ..simulation.batch.lane import WINDOW, Lane, Orders, begin_lane, turn
from ..simulation.batch.scheduler import Batch
from ..simulation.batch.tasks import Common, Task
from ..simulation.derivative_runs import derivative_scheme
from ..simulation.method import Scheme
from ..simulation.rates import rates_of
from ..simulation.run_checks import check_precision, check_start
from ..simulation.run_ends import begin_run
from ..simulation.sampling import Sampled, sampled_compiled
from ..simulation.settings import Settings, settings_or
from ..simulation.step_state import Method, Step, Variables
from ..simulation.stepping import attempt
from ..simulation.systems import SystemFamily
from ..simulation.variational import start_with_tangents
from ..sweeps.work import Work

P = ParamSpec("P")
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

        def rates(system: System, y: Variables, memory: Memory) -> tuple[Variables, None]:
            return rates_of(system, y, memory, step.t), None

        if self.family is None:
            return rates(self.system, step.y, step.memory)[0]
        assert step.tangents is not None
        along = step.tangents.y, step.tangents.memory
        value, _, derivatives = self.family.pushed(rates, (step.y, step.memory), along)
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
            rates = rates_of(self.system, y, step.memory, jnp.asarray(t))
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
    form: Structured
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
        form = structured(scene)
        span = (jnp.asarray(number) for number in (time, END, FIRST_STEP))
        if parameters is None:
            redundant = check_start(scene, state, time, settings.coordinates)
            scheme = Scheme.of(settings, bool(redundant))
            step = begin_run(scheme.method, scheme.unpacked(form), state, *span)
            return RunProgram(scheme, form, step, None)
        scheme = derivative_scheme(scene, state, settings, time)
        values = jnp.asarray(coordinates_of(scene, state, parameters))
        family = parametrised(scene, state, parameters, values)
        systems = SystemFamily(family, scheme.formulation)
        return RunProgram(scheme, form, start_with_tangents(scheme.method, systems, *span), family)

    def stepper(self) -> Stepper:
        """What happens at a step. Inside a traced function, the scene's numbers are those given to
        it."""
        if self.family is not None:
            systems = SystemFamily(self.family, self.scheme.formulation)
            return Stepper(self.scheme.method, systems.system(), systems)
        return Stepper(self.scheme.method, self.scheme.unpacked(self.form))


@dataclass(frozen=True)
class SweepProgram:
    """What a call of `sweep` ran, on one device.

    `work`: its lanes; `batch`: how they were run.

    >>> stiffness = cj.Axis(lambda scene: scene.forces["spring"].stiffness, [100.0, 400.0])
    >>> speed = cj.Peak(cj.quantities.Velocity("ball"), "m/s")
    >>> with testing.programs_of_sweeps() as programs:
    ...     _ = cj.sweep(scene, state, 0.1, {"stiffness": stiffness}, {"v": speed}, progress=False)
    >>> type(programs[0]).__name__
    'SweepProgram'
    """

    work: Work
    batch: Batch

    @property
    def turns(self) -> int:
        """Turns that were given to lanes and to empty columns."""
        return self.batch.turns

    @cached_property
    def lane(self) -> Lane:
        """The first lane before its first step."""
        return begin_lane(
            self._common.plan,
            self._scene,
            self._task.state,
            self._common.start_time,
            self._orders,
        )

    def stepper(self) -> Stepper:
        """What happens at a step of the lane, which is ``lane.step``."""
        scheme = self._common.plan.scheme
        return Stepper(scheme.method, scheme.system(self._scene))

    def turn(self, lane: Lane) -> Lane:
        """What a turn makes of a lane: a step, reductions, what is recorded. Traceable."""
        return turn(self._common.plan, self._scene, lane, self._orders)

    @cached_property
    def _task(self) -> Task:
        return jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), self.work.tasks)

    @cached_property
    def _scene(self) -> Scene:
        return self._common.scene(self._task)

    @property
    def _orders(self) -> Orders:
        task, never = self._task, jnp.full(WINDOW, jnp.inf)
        return Orders(task.end_time, task.first_step, never, self._common.capacity)

    @cached_property
    def _common(self) -> Common:
        return jax.tree.map(
            lambda leaf: jnp.asarray(leaf) if isinstance(leaf, np.ndarray) else leaf,
            self.work.common,
        )


@contextmanager
def programs_of_sweeps() -> Iterator[list[SweepProgram]]:
    """A list to which each call of `sweep` inside adds what it ran.

    >>> stiffness = cj.Axis(lambda scene: scene.forces["spring"].stiffness, [100.0, 400.0])
    >>> speed = cj.Peak(cj.quantities.Velocity("ball"), "m/s")
    >>> with testing.programs_of_sweeps() as programs:
    ...     _ = cj.sweep(scene, state, 0.1, {"stiffness": stiffness}, {"v": speed}, progress=False)
    >>> type(programs[0]).__name__
    'SweepProgram'
    """
    programs: list[SweepProgram] = []
    with patch.object(Work, "run", _recording(Work.run, programs)):
        yield programs


def _recording(
    run: Callable[Concatenate[Work, P], Batch], programs: list[SweepProgram]
) -> Callable[Concatenate[Work, P], Batch]:
    """The method that runs the work of a sweep, which also adds what it ran to the programs."""

    def run_and_record(work: Work, *arguments: P.args, **settings: P.kwargs) -> Batch:
        batch = run(work, *arguments, **settings)
        programs.append(SweepProgram(work, batch))
        return batch

    return run_and_record


def compiled_sensitivities(
    scene: Scene,
    state: State,
    end_time: float,
    parameters: Mapping[str, Parameter],
    outputs: Mapping[str, Quantity],
    settings: Settings,
) -> Callable[[], Sampled]:
    """The compiled run inside `sensitivities`, from time zero, which looks at the end alone.

    What it returns has `values` (1,), `derivatives` (1, p) by output, and `attempts`, on the
    device.

    >>> run = testing.compiled_sensitivities(
    ...     scene, state, 0.3, {"stiffness": stiffness}, {"x": x}, cj.presets.derivatives
    ... )
    >>> run().values["x"].shape
    (1,)
    """
    coordinates = jnp.asarray(coordinates_of(scene, state, parameters))
    family = parametrised(scene, state, parameters, coordinates)
    scheme, end = derivative_scheme(scene, state, settings), jnp.asarray(end_time)
    limit = jnp.asarray(settings.max_steps, int)
    span = (end[None], jnp.zeros(()), end, settings.length_of_first_step(0.0, end), limit)
    return lambda: sampled_compiled(scheme, family, dict(outputs), *span)
