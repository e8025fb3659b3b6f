"""Outputs of runs as a function of parameters that JAX differentiates in reverse mode."""

import math
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from ..._compilation.xla import SharedFunctions, one_call
from ..._dynamics.constraint_report import check_names
from ..._export.datasets import setting_notes
from ..._fields.checks import require
from ..._fields.objects import with_arrays
from ..._fields.types import ArrayLike
from ..._math.vectors import fold_constants
from ..._model.bodies import State
from ..._model.scene import Scene
from ..._parametrisation.parametrised_scene import DirectedScene
from ..._parametrisation.parts import Part, guard_direction, parts_of
from ...quantities.base import Quantity
from ..reductions.base import AbstractReduction, result_name
from ..results.solution import SimulationError, raise_failure
from ..step import presets
from ..step.settings import Settings, check_span, checked_times, settings_or
from .adjoint import Adjoint
from .outputs import EXAMPLE, ImpactTable, Requested, requested_by
from .recorded_runs import RecordedRun, Recorder, integrands_of
from .rejections import RejectedSteps
from .run_checks import derivative_scheme, is_traced
from .sections import Section

T = TypeVar("T")
KEPT_RUNS, KEPT_BYTES = 4, 240_000_000
"""Number of latest runs that a predictor always keeps, so that a gradient does not repeat the runs
that have computed the outputs; and bytes of recorded steps up to which it keeps further runs."""
GUARD_TOLERANCE = 0.3
"""Factor of the tolerance of derivatives in runs with several parameters. Only the error of the
guard, the derivative along one direction of all parameters (see `.adjoint`), is then controlled.
With a factor of 1, derivatives by a clearance that hardly changes the guard were wrong by 2e-6 and
7e-6 at an `rtol` of 1e-9, where forward mode has errors of 2e-8 to 8e-8; with 0.3 by 6e-8 and 6e-7,
in 1.1 to 1.2 times as many steps, which are still fewer than those of forward mode."""
AT_ONCE = 64
"""Largest number of runs of a batch that are computed side by side. Each may keep steps of up to 30
MB (`.recorded_runs`) until their outputs or gradients are computed."""


class Predictor:
    """Function of parameters that returns the outputs of a run; see `predictor`.

    - `values`: the values that the parameters have in the scene and state given to `predictor`, by
      name, in SI units; the function takes a dictionary of the same form.

    >>> paths = {"stiffness": lambda scene: scene.forces["spring"].stiffness}
    >>> predict = cj.predictor(scene, state, 0.3, paths, {"x": x}, times)
    >>> float(predict.values["stiffness"])
    100.0
    """

    def __init__(
        self,
        scene: Scene,
        state: State,
        span: tuple[float, float],
        paths: Mapping[str, Part],
        outputs: Requested,
        times: Float[np.ndarray, " times"],
        settings: Settings,
    ):
        self._settings, self._span, self._times = settings, span, times
        self._outputs = outputs
        derivative_scheme(scene, state, settings, span[0])  # raises errors of unsuitable arguments
        numbers, changes = parts_of(scene, state, paths)
        self.values: dict[str, PyTree] = numbers
        scene, state = with_arrays((scene, state))
        # Derivatives along this random direction choose the steps of a run (see `guard_direction`).
        direction = guard_direction(paths, numbers)
        family = DirectedScene(
            values=numbers, direction=direction, base=(scene, state), changes=changes, patterns=()
        )
        # Zeros and ones of the scene that no parameter changes become constants of the program.
        self._family = replace(family, patterns=fold_constants(scene, family.varied()).patterns)
        self._runs: OrderedDict[bytes, RecordedRun] = OrderedDict()
        # Functions that the programs of values and gradients share (see `one_call`).
        self._traced: SharedFunctions = {}
        # Recorders, made when needed. The key says whether constraints are redundant: the equations
        # of motion are then solved in another way.
        self._recorders: dict[bool, Recorder] = {}
        self._shapes = {n: jax.ShapeDtypeStruct(times.shape, float) for n in outputs.quantities}
        for name, reduction in outputs.reductions.items():
            for part in reduction.differentiated:
                self._shapes[result_name(name, part)] = jax.ShapeDtypeStruct((), float)

        @jax.custom_vjp
        def predict(values: dict[str, PyTree]) -> dict[str, jax.Array]:
            return on_host(self._values, self._shapes, values)

        def backward(values: PyTree, cotangents: PyTree) -> tuple[PyTree]:
            # A value may be a float of Python, which has no shape.
            shapes = jax.tree.map(lambda v: jax.ShapeDtypeStruct(np.shape(v), float), values)
            return (on_host(self._gradient, shapes, values, cotangents),)

        # The backward pass needs only the values: it looks up the recorded run by them.
        predict.defvjp(lambda values: (predict(values), values), backward)
        self._predict = predict

    def __call__(self, values: Mapping[str, PyTree]) -> dict[str, Float[Array, "..."]]:
        """Return the outputs for `values` of the parameters, SI, which have the form of the
        attribute `values`. Outputs are arrays, (N,) for a quantity and () for each result of a
        reduction. Leaves that are no arrays of floats, such as functions of a network, are ignored.

        **Raises:** `ValueError` for values of another form, and for numbers that the scene can't
        have; `SimulationError` if the run fails. Inside of `jax.jit` and `jax.vmap`, JAX raises an
        error of its own, whose text contains that of the `ValueError` or `SimulationError`.
        """
        return self._predict(self._checked(values))

    def or_nan(self, values: Mapping[str, PyTree]) -> dict[str, Float[Array, "..."]]:
        """Return the outputs for `values`, as when the object is called, but without derivatives,
        and with NaN for a run that fails and for numbers that the scene can't have. Raise a
        `ValueError` for values whose form is not that of the attribute `values`."""

        def computed(values: dict[str, PyTree]) -> dict[str, np.ndarray]:
            return self._values(values, or_nan=True)

        return on_host(computed, self._shapes, self._checked(values))

    def _checked(self, values: Mapping[str, PyTree]) -> dict[str, PyTree]:
        expected = sorted(self.values)
        remedy = "pass a dictionary with a value for each of the paths"
        given = sorted(values) if isinstance(values, Mapping) else values
        require(given == expected, "values", given, f"a dictionary with {expected}", remedy)
        return {name: self._numbers(name, values[name]) for name in self.values}

    def _numbers(self, name: str, value: PyTree) -> PyTree:
        leaves, structure = jax.tree.flatten(self.values[name])
        given = jax.tree.leaves(value)
        if not eqx.is_array(self.values[name]):
            # Of an element, only the arrays of floats are parameters.
            given = jax.tree.leaves(eqx.filter(value, eqx.is_inexact_array))
        shapes, needed = [np.shape(g) for g in given], [np.shape(leaf) for leaf in leaves]
        expected = f"arrays of shapes {needed}"
        remedy = "pass numbers of the shapes of the scene's, for example those of predict.values"
        require(shapes == needed, f"values[{name!r}]", shapes, expected, remedy)
        return jax.tree.unflatten(structure, [_as_floats(leaf) for leaf in given])

    def _values(self, values: dict[str, PyTree], or_nan: bool = False) -> dict[str, np.ndarray]:
        elements, shape = self._elements(values)
        outputs: list[dict[str, np.ndarray]] = []
        with one_call(self._traced):
            for group in _groups(elements):
                for run in self._recorded(group, or_nan):
                    outputs.append(self._outputs_of(run, or_nan))
        return _in_batch(outputs, shape)

    def _outputs_of(self, run: RecordedRun | None, or_nan: bool) -> dict[str, np.ndarray]:
        try:
            if run is not None:
                return run.values()
        except ValueError:  # for instance, of a window that the run does not reach
            if not or_nan:
                raise
        return {name: np.full(of.shape, np.nan) for name, of in self._shapes.items()}

    def _gradient(self, values: dict[str, PyTree], cotangents: dict[str, PyTree]) -> PyTree:
        batch = _batch_shape(self._shapes, cotangents)
        # The values and the cotangents may have different axes of a batch, and are broadcast.
        elements, shape = self._elements(values, batch)
        by_element = _elements_of(self._shapes, cotangents, shape)
        gradients: list[PyTree] = []
        with one_call(self._traced):
            for group, of_group in zip(_groups(elements), _groups(by_element), strict=True):
                # A failed run raises an error here, so that none is ``None``.
                runs = [run for run in self._recorded(group) if run is not None]
                gradients += _gradients(runs, of_group)
        return _in_batch(gradients, shape)

    def _elements(
        self, values: dict[str, PyTree], batch: tuple[int, ...] = ()
    ) -> tuple[list[dict[str, PyTree]], tuple[int, ...]]:
        shape = np.broadcast_shapes(_batch_shape(self.values, values), batch)
        return _elements_of(self.values, values, shape), shape

    def _recorded(
        self, values: list[dict[str, PyTree]], or_nan: bool = False
    ) -> list[RecordedRun | None]:
        """Return a run, new or kept from an earlier call, for each of the `values` of the
        parameters. An invalid or failed run raises an error, or is ``None`` with `or_nan`."""
        # A run is kept by the bytes of its parameters. Kept runs are taken out here and put back
        # below, so that the last ones in `_runs` are those used last.
        keys = [b"".join(leaf.tobytes() for leaf in jax.tree.leaves(at)) for at in values]
        runs = {key: run for key in keys if (run := self._runs.pop(key, None)) is not None}
        missing = {key: at for key, at in zip(keys, values, strict=True) if key not in runs}
        # Runs of one recorder are computed side by side.
        by_recorder: dict[Recorder, list[bytes]] = {}
        for key, at in missing.items():
            try:
                by_recorder.setdefault(self._recorder(at), []).append(key)
            except ValueError:
                if not or_nan:
                    raise
        for recorder, of_recorder in by_recorder.items():
            made = recorder.recorded([missing[key] for key in of_recorder])
            for key, run in zip(of_recorder, made, strict=True):
                try:
                    raise_failure(run.solution(setting_notes(vars(self._settings))))
                    runs[key] = run
                except SimulationError:
                    if not or_nan:
                        raise
        self._runs |= runs
        # The first of the kept runs is the one whose last use is the earliest.
        total = sum(run.bytes_kept for run in self._runs.values())
        while len(self._runs) > KEPT_RUNS and total > KEPT_BYTES:
            total -= self._runs.popitem(last=False)[1].bytes_kept
        return [runs.get(key) for key in keys]

    def _recorder(self, values: dict[str, PyTree]) -> Recorder:
        settings, (start, end) = self._settings, self._span
        scene, state = self._family.scene_and_state(values)
        scheme = derivative_scheme(scene, state, settings, start)
        # Whether constraints are redundant: the equations are then solved in another way.
        redundant = scheme.formulation.redundant
        if redundant not in self._recorders:
            reductions = self._outputs.reductions
            # Integrals that reductions need are integrated with the motion.
            formulation = replace(scheme.formulation, integrands=integrands_of(reductions))
            method, parameter_count = scheme.method, sum(map(np.size, jax.tree.leaves(values)))
            assert method.derivative_tolerance is not None
            # Only the error of one derivative, along the guard's direction (see `.adjoint`), is
            # controlled. For a single number, this is the wanted derivative. For several, it stands
            # for all derivatives, of which some have larger errors: hence a smaller tolerance.
            if parameter_count > 1:
                tolerance = GUARD_TOLERANCE * method.derivative_tolerance
                method = replace(method, derivative_tolerance=tolerance)
            run = Adjoint(
                scheme=replace(scheme, method=method, formulation=formulation),
                family=self._family,
                # Only reductions such as `Peak` are updated in steps, to find their instants.
                reductions={n: o for n, o in reductions.items() if o.finds_instants},
                origin=np.asarray(start, float),
                end=np.asarray(end, float),
                first_step=np.asarray(settings.length_of_first_step(start, end), float),
                max_steps=np.asarray(settings.max_steps),
            )
            self._recorders[redundant] = Recorder(run, self._outputs, self._times)
        return self._recorders[redundant]


def _gradients(runs: list[RecordedRun], cotangents: list[dict[str, np.ndarray]]) -> list[PyTree]:
    # A recorder computes the gradients of its runs side by side. Those with redundant constraints
    # have another recorder (see `Predictor._recorder`).
    gradients: list[PyTree] = [None] * len(runs)
    # A dictionary keeps each recorder once, in the order of the runs.
    for recorder in {run.recorder: None for run in runs}:
        indices = [k for k, run in enumerate(runs) if run.recorder is recorder]
        of_recorder = recorder.gradients(
            [runs[k] for k in indices], [cotangents[k] for k in indices]
        )
        for k, gradient in zip(indices, of_recorder, strict=True):
            gradients[k] = gradient
    return gradients


def _batch_shape(examples: PyTree, arrays: PyTree) -> tuple[int, ...]:
    """Return the shape of a batch of elements like `examples`: the axes that each of `arrays` has
    before the axes of its example, broadcast over all arrays; ``()`` without a batch."""
    pairs = zip(jax.tree.leaves(examples), jax.tree.leaves(arrays), strict=True)
    return np.broadcast_shapes(
        *(np.shape(array)[: np.ndim(array) - len(np.shape(example))] for example, array in pairs)
    )


def _elements_of(examples: PyTree, arrays: PyTree, shape: tuple[int, ...]) -> list[PyTree]:
    """Return the elements of a batch, in row-major order, each with the structure and the shapes of
    the PyTree `examples`. The leaves of `arrays` have axes of the batch in front of the axes of an
    element. These axes are broadcast to `shape`."""

    def flat(example: PyTree, array: ArrayLike) -> np.ndarray:
        of_element = np.shape(example)
        array = np.asarray(array, float)
        return np.broadcast_to(array, (*shape, *of_element)).reshape(-1, *of_element)

    columns = jax.tree.map(flat, examples, arrays)
    count = math.prod(shape)
    return [jax.tree.map(lambda column, k=k: np.array(column[k]), columns) for k in range(count)]


def _in_batch(trees: list[PyTree], shape: tuple[int, ...]) -> PyTree:
    return jax.tree.map(lambda *leaves: np.reshape(leaves, (*shape, *np.shape(leaves[0]))), *trees)


def _groups(elements: list[T]) -> list[list[T]]:
    return [elements[start : start + AT_ONCE] for start in range(0, len(elements), AT_ONCE)]


def _as_floats(leaf: ArrayLike) -> jax.Array | np.ndarray:
    # JAX would put each number on its device, or trace a conversion, which takes longer than a
    # short run.
    if isinstance(leaf, jax.Array):
        return leaf if leaf.dtype == np.dtype(float) else jnp.asarray(leaf, float)
    return np.asarray(leaf, float)


def on_host(function: Callable[..., PyTree], shapes: PyTree, *arguments: PyTree) -> PyTree:
    """Return the result of a function of NumPy arrays for `arguments`. If JAX traces these, its
    compiled code calls the function. `shapes`: a PyTree of the result's shapes and dtypes."""
    if is_traced(arguments):
        return jax.pure_callback(function, shapes, *arguments, vmap_method="expand_dims")
    # A callback would wrap the error of a run that fails in one of JAX's own.
    return jax.tree.map(jnp.asarray, function(*arguments))


def predictor(
    scene: Scene,
    state: State,
    end_time: float,
    paths: Mapping[str, Part],
    outputs: Mapping[str, Quantity | AbstractReduction],
    times: ArrayLike | None = None,
    settings: Settings | None = None,
    *,
    start_time: float = 0.0,
) -> Predictor:
    """Return outputs of a run as a function of parameters, with derivatives in reverse mode.

    >>> import jax, optax
    >>> paths = {"stiffness": lambda scene: scene.forces["spring"].stiffness}
    >>> predict = cj.predictor(scene, state, 0.3, paths, {"x": x}, times)
    >>> loss = lambda values: jnp.sum((predict(values)["x"] - 0.1 * jnp.cos(11.0 * times)) ** 2)
    >>> values, optimiser = predict.values, optax.adam(1.0)
    >>> gradient, memory = jax.grad(loss)(values), optimiser.init(values)
    >>> change, memory = optimiser.update(gradient, memory)
    >>> values = optax.apply_updates(values, change)  # and again, until the loss is small
    >>> print(f"{values['stiffness']:.1f} N/m")  # on the way from 100 to 121
    101.0 N/m

    The derivatives are those of the exact motion, as those of `sensitivities`, of which this is the
    reverse mode: a gradient costs as much as a few runs, whatever the number of parameters.
    `sensitivities` costs about one run for each parameter. The function works under `jax.grad`,
    `jax.vjp`, `jax.jacrev`, `jax.jit` and `jax.vmap`, not under `jax.jvp`. Under `jax.vmap`, the
    runs of a batch are computed side by side in vectors of the processor.

    The steps of a run are controlled by the errors of the state and of its derivative along one
    random direction of all parameters, which is always the same. If the parameters hardly move the
    first impacts, the steps may be too long for some of the derivatives: compare these with those
    of `sensitivities` once, and lower `rtol` in the settings if they differ.

    **Arguments:**

    - `scene`, `state`, `start_time`, `end_time`: as in `simulate`.
    - `paths`: the parameters by names of your choice. Each is a `Parameter`, whose scale then
      serves only to choose the random direction, or a function of the scene that selects a number,
      an array, or a whole element, such as an `equinox.nn.MLP` inside of your friction law; of an
      element all arrays of floats are parameters.
    - `outputs`: quantities by name, as in `sensitivities`, and reductions `Integral`, `Statistics`
      (mean and root mean square), `Peak` (the value), `DissipatedEnergy` and `MeanPowerLost`.
      Windows must have fixed edges; a peak must be smooth, or at a fixed time. Integrated
      quantities may jump at contact events and breakpoints; if several of these coincide, the mean
      of their times is used, which is exact if the parameters shift all of them alike.
    - `times`: (N,) s, not decreasing, between start and end, at which quantities are evaluated; may
      be left out if the outputs have no quantity.
    - `settings`: tolerances, solver and coordinates; `clearjoint.presets.derivatives` unless given.

    **Raises:** `ValueError` for invalid arguments, as `sensitivities`. Gradients raise one for a
    peak at a contact event, or at a breakpoint that depends on the parameters.
    """
    check_names(scene, state)
    requested = requested_by(outputs, None)
    expected = "a quantity or a reduction in reverse mode"
    remedy = "pass a quantity or a reduction such as cj.Peak"
    requested.refuse(Section | ImpactTable | RejectedSteps, expected, remedy)
    for name, reduction in requested.reductions.items():
        is_smooth, argument = bool(reduction.differentiated), f"outputs[{name!r}]"
        expected = "a reduction with derivatives in reverse mode"
        remedy = "pass cj.Integral, cj.Statistics, cj.Peak, cj.DissipatedEnergy or MeanPowerLost"
        require(is_smooth, argument, reduction, expected, remedy)
    require(len(outputs) > 0, "outputs", {}, "not empty", EXAMPLE)
    settings = settings_or(settings, presets.derivatives)
    requested.check(scene, settings.ledger)
    check_span(start_time, end_time)
    # Without quantities no times are needed.
    checked = np.zeros(0)
    if requested.quantities or times is not None:
        remedy = "pass the times at which quantities are evaluated"
        require(times is not None, "times", None, f"times for {list(requested.quantities)}", remedy)
        checked = checked_times(start_time, end_time, times)  # pyright: ignore
    span = float(start_time), float(end_time)
    return Predictor(scene, state, span, paths, requested, checked, settings)
