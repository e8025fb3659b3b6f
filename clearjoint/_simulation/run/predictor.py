"""Outputs of runs as a function of parameters that JAX differentiates in reverse mode."""

from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

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
from .adjoint import Adjoint, RecordedRun, integrands_of
from .outputs import EXAMPLE, ImpactTable, Kept, kept_by
from .rejections import RejectedSteps
from .run_checks import derivative_scheme, is_traced
from .sections import Section

KEPT_RUNS = 4
"""Number of runs that a predictor keeps, so that a gradient does not repeat that of the values."""


class Predictor:
    """Function of parameters that returns the outputs of a run; see `predictor`.

    - `values`: the parameters of the scene and state that were given to `predictor`, as the
      function takes them: a dictionary by name, SI.

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
        outputs: Kept,
        times: Float[np.ndarray, " times"],
        settings: Settings,
    ):
        self._settings, self._span, self._times = settings, span, times
        self._outputs = outputs
        derivative_scheme(scene, state, settings, span[0])
        numbers, changes = parts_of(scene, state, paths)
        self.values: dict[str, PyTree] = numbers
        scene, state = with_arrays((scene, state))
        direction = guard_direction(paths, numbers)
        family = DirectedScene(
            values=numbers, direction=direction, base=(scene, state), changes=changes, patterns=()
        )
        self._family = replace(family, patterns=fold_constants(scene, family.varied()).patterns)
        self._runs: OrderedDict[bytes, RecordedRun] = OrderedDict()
        self._shapes = {n: jax.ShapeDtypeStruct(times.shape, float) for n in outputs.quantities}
        for name, reduction in outputs.reductions.items():
            for part in reduction.differentiated:
                self._shapes[result_name(name, part)] = jax.ShapeDtypeStruct((), float)

        @jax.custom_vjp
        def predict(values: dict[str, PyTree]) -> dict[str, jax.Array]:
            return on_host(self._values, self._shapes, values)

        def backward(values: PyTree, cotangents: PyTree) -> tuple[PyTree]:
            shapes = jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape, float), values)
            return (on_host(self._gradient, shapes, values, cotangents),)

        predict.defvjp(lambda values: (predict(values), values), backward)
        self._predict = predict

    def __call__(self, values: Mapping[str, PyTree]) -> dict[str, Float[Array, "..."]]:
        """Return the outputs for `values` of the parameters, SI, which have the form of the
        attribute `values`: quantities, (N,) each, and results of reductions, numbers. Leaves that
        are no arrays of floats, such as functions of a network, are ignored.

        **Raises:** `ValueError` for values of another form, and for numbers that the scene can't
        have; `SimulationError` if the run fails. Inside of `jax.jit` and `jax.vmap`, JAX raises an
        error of its own with the text of these.
        """
        expected = sorted(self.values)
        remedy = "pass a dictionary with a value for each of the paths"
        given = sorted(values) if isinstance(values, Mapping) else values
        require(given == expected, "values", given, f"a dictionary with {expected}", remedy)
        numbers = {name: self._numbers(name, values[name]) for name in self.values}
        return self._predict(numbers)

    def or_nan(self, values: Mapping[str, PyTree]) -> dict[str, Float[Array, "..."]]:
        """Return the outputs as a call does, but NaN for values of a run that fails and for values
        that the scene can't have. The function has no derivatives."""

        def computed(values: dict[str, PyTree]) -> dict[str, np.ndarray]:
            try:
                return self._values(values)
            except (SimulationError, ValueError):
                return {name: np.full(of.shape, np.nan) for name, of in self._shapes.items()}

        numbers = {name: self._numbers(name, values[name]) for name in self.values}
        return on_host(computed, self._shapes, numbers)

    def _numbers(self, name: str, value: PyTree) -> PyTree:
        leaves, structure = jax.tree.flatten(self.values[name])
        given = jax.tree.leaves(value)
        if not eqx.is_array(self.values[name]):
            # Of an element, only the arrays of floats are parameters.
            given = jax.tree.leaves(eqx.filter(value, eqx.is_inexact_array))
        shapes, expected = [np.shape(g) for g in given], [np.shape(leaf) for leaf in leaves]
        remedy = "pass numbers of the shapes of the scene's, for example those of predict.values"
        require(
            shapes == expected, f"values[{name!r}]", shapes, f"arrays of shapes {expected}", remedy
        )
        return jax.tree.unflatten(structure, [_as_floats(leaf) for leaf in given])

    def _values(self, values: dict[str, PyTree]) -> dict[str, np.ndarray]:
        return self._run(values).values()

    def _gradient(self, values: dict[str, PyTree], cotangents: dict[str, PyTree]) -> PyTree:
        along = {name: np.asarray(cotangent, float) for name, cotangent in cotangents.items()}
        return self._run(values).gradient(along)

    def _run(self, values: dict[str, PyTree]) -> RecordedRun:
        values = jax.tree.map(lambda leaf: np.asarray(leaf, float), values)
        key = b"".join(leaf.tobytes() for leaf in jax.tree.leaves(values))
        run = self._runs.pop(key, None)
        if run is None:
            run = self._recorded(values)
        self._runs[key] = run
        while len(self._runs) > KEPT_RUNS:
            self._runs.popitem(last=False)
        return run

    def _recorded(self, values: dict[str, PyTree]) -> RecordedRun:
        settings, (start, end) = self._settings, self._span
        scene, state = self._family.scene_and_state(values)
        scheme = derivative_scheme(scene, state, settings, start)
        family = replace(self._family, values=values)
        first_step = settings.length_of_first_step(start, end)
        integrands = integrands_of(self._outputs.reductions)
        scheme = replace(scheme, formulation=replace(scheme.formulation, integrands=integrands))
        adjoint = Adjoint(scheme, family, np.asarray(start, float))
        run = RecordedRun(adjoint, self._outputs, self._times, end, first_step, settings.max_steps)
        raise_failure(run.solution(setting_notes(settings)))
        return run


def _as_floats(leaf: ArrayLike) -> jax.Array | np.ndarray:
    # JAX would put each number on its device, or trace a conversion, which takes longer than a
    # short run.
    if isinstance(leaf, jax.Array):
        return leaf if leaf.dtype == np.dtype(float) else jnp.asarray(leaf, float)
    return np.asarray(leaf, float)


def on_host(function: Callable[..., PyTree], shapes: PyTree, *arguments: PyTree) -> PyTree:
    """Return the result of a function of arrays that Python computes, of known `shapes`."""
    if is_traced(arguments):
        return jax.pure_callback(function, shapes, *arguments, vmap_method="sequential")
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
    """Return a function of parameters that simulates a scene and returns outputs, with derivatives
    in reverse mode.

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
    `jax.vjp`, `jax.jacrev`, `jax.jit` and `jax.vmap`, which calls it for one element of a batch
    after the other; not under `jax.jvp`.

    The steps of a run are controlled by the errors of the state and of its derivative along one
    random direction of all parameters, which is always the same. If the parameters hardly move the
    first impacts, the steps may be too long for the derivatives by others: compare with
    `sensitivities` once, and lower `rtol` in the settings if they differ.

    **Arguments:**

    - `scene`, `state`, `start_time`, `end_time`: as in `simulate`.
    - `paths`: the parameters by names of your choice. Each is a `Parameter`, whose scale then
      serves only to choose the random direction, or a function of the scene that selects a number,
      an array, or a whole element, such as an `equinox.nn.MLP` inside of your friction law; of an
      element all arrays of floats are parameters.
    - `outputs`: quantities by name, as in `sensitivities`, and reductions `Integral`, `Statistics`
      (mean and root mean square), `Peak` (the value), `DissipatedEnergy` and `MeanPowerLost`. A
      quantity whose integral is taken must be a continuous function of time, and windows must have
      fixed edges.
    - `times`: (N,) s, not decreasing, between start and end, at which quantities are evaluated.
    - `settings`: tolerances, solver and coordinates; `clearjoint.presets.derivatives` unless given.

    **Raises:** `ValueError` for invalid arguments, as `sensitivities`.
    """
    kept = kept_by(outputs, None)
    expected = "a quantity or a reduction in reverse mode"
    remedy = "pass a quantity or a reduction such as cj.Peak"
    kept.refuse(Section | ImpactTable | RejectedSteps, expected, remedy)
    for name, reduction in kept.reductions.items():
        is_smooth, argument = bool(reduction.differentiated), f"outputs[{name!r}]"
        expected = "a reduction with derivatives in reverse mode"
        remedy = "pass cj.Integral, cj.Statistics, cj.Peak, cj.DissipatedEnergy or MeanPowerLost"
        require(is_smooth, argument, reduction, expected, remedy)
    require(len(outputs) > 0, "outputs", {}, "not empty", EXAMPLE)
    settings = settings_or(settings, presets.derivatives)
    kept.check(scene, settings.ledger)
    check_span(start_time, end_time)
    checked = np.zeros(0)
    if kept.quantities or times is not None:
        remedy = "pass the times at which quantities are evaluated"
        require(times is not None, "times", None, f"times for {list(kept.quantities)}", remedy)
        checked = checked_times(start_time, end_time, times, "times")  # pyright: ignore
    span = float(start_time), float(end_time)
    return Predictor(scene, state, span, paths, kept, checked, settings)
