"""Derivatives of the wear of some cycles with respect to parameters.

A parameter changes the wear of a stage directly, and through the depths of the stages before. So
each parameter of a run with derivatives moves a number of the scene and, at the same time, the
profiles along the derivatives of their depths.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float
from typing_extensions import override

from .._fields.checks import require
from .._fields.objects import on_device, quantity
from .._fields.types import Column
from .._math.vectors import Scalar
from .._model.bodies import State
from .._model.profiles import AbstractPeriodicSpline, periodic
from .._model.scene import Scene
from .._parametrisation.parameter import AbstractScale, Parameter
from .._parametrisation.variations import Change
from .._result_codes import RESULTS
from .._simulation.run.sensitivities import sensitivities
from .._simulation.step.settings import Settings
from .wear_depths import SIGNALS, Signal, depths_from_signals
from .wear_rates import PARTS, PROFILES, Part

Rates = Mapping[str, tuple[float, float]]
"""Specific wear rates of bearing and journal, m^2/N, by name of the joint."""


class MovingSpline(AbstractPeriodicSpline):
    """A worn profile that p parameters move: a periodic spline with N knots, whose coefficients are
    `coefficients`, m, plus, for each parameter, its shift times its N directions.

    - `directions`: (p N,) m, the derivatives of the N coefficients with respect to the first
      parameter, then those with respect to the second, and so on.
    - `shifts`: (p,) by how much each parameter's coordinate is changed. They are zero: only
      derivatives with respect to them are taken.
    """

    coefficients: Column = quantity("m", table=True)
    # The directions are numbers of the scene because they change from stage to stage, and a change
    # of anything else would compile the run again.
    directions: Column = quantity("m", table=True)
    shifts: Column = quantity("1", table=True)

    @override
    def coefficients_around(self, knot: jax.Array | np.ndarray) -> jax.Array:
        around, count = periodic(on_device(self.coefficients), knot), self.angles()
        # `directions` has `count` numbers for each parameter.
        for k in range(np.shape(self.shifts)[0]):
            row = on_device(self.directions)[k * count : (k + 1) * count]
            around = around + self.shifts[k] * periodic(row, knot)
        return around

    @override
    def angles(self) -> int:
        return np.shape(self.coefficients)[0]


@dataclass(frozen=True)
class ParameterDirection:
    """Function that changes one parameter: its number in the scene or state, and all profiles that
    wear, since with a changed parameter the stages before would have worn them differently.

    - `index`: index of the parameter in the `shifts` of each `MovingSpline`.
    - `joints`: names of the joints that wear.
    - `change`, `scale`: how the number is set from a coordinate; ``None`` for a wear rate, on which
      a run depends only through the profiles.
    - `coordinate`: present coordinate of the parameter.
    """

    index: int
    joints: tuple[str, ...]
    change: Change | None = None
    scale: AbstractScale | None = None
    coordinate: float = 0.0

    def __call__(self, scene: Scene, state: State, value: Scalar) -> tuple[Scene, State]:
        """Return scene and state for the coordinate `coordinate` + `value`."""
        scene, state = self.without_profiles(scene, state, value)
        for name in self.joints:
            for field in PROFILES:
                # A part that doesn't wear has a profile of another class, which doesn't move.
                profile = getattr(scene.joints[name], field)
                if isinstance(profile, MovingSpline):
                    shifts = on_device(profile.shifts).at[self.index].add(value)
                    scene = eqx.tree_at(
                        lambda s, n=name, f=field: getattr(s.joints[n], f).shifts, scene, shifts
                    )
        return scene, state

    def without_profiles(self, scene: Scene, state: State, value: Scalar) -> tuple[Scene, State]:
        """Return scene and state for `coordinate` + `value`, with unchanged profiles."""
        if self.change is None or self.scale is None:  # a wear rate, which a scene doesn't contain
            return scene, state
        return self.change(scene, state, self.scale.value(self.coordinate + value))


def directions_of(
    scene: Scene, state: State, rates: Rates, parameters: Mapping[str, Parameter]
) -> dict[str, ParameterDirection]:
    """Return a `ParameterDirection` by name for each parameter, then, named by `rate_name`, for the
    logarithm of each positive wear rate. Profiles of `scene` that wear must be `MovingSpline`s."""
    joints = tuple(rates)
    directions: dict[str, ParameterDirection] = {}
    for name, parameter in parameters.items():
        # The example of a value, 0.0, says that the number is a scalar.
        change = parameter.variation.setter(scene, state, 0.0)
        coordinate, index = float(parameter.coordinate_in(scene, state)), len(directions)
        directions[name] = ParameterDirection(index, joints, change, parameter.scale, coordinate)
    for joint, of_parts in rates.items():
        for part, rate in zip(PARTS, of_parts, strict=True):
            if rate > 0.0:
                name = rate_name(joint, part)
                expected = "named otherwise than the logarithm of a wear rate"
                require(name not in parameters, "parameters", name, expected, "rename it")
                directions[name] = ParameterDirection(len(directions), joints)
    return directions


def rate_name(joint: str, part: Part) -> str:
    """Name of a wear rate's logarithm as a parameter, such as "pin bearing rate"."""
    return f"{joint} {part} rate"


def derivatives_in_spans(
    scene: Scene,
    state: State,
    start_time: float,
    spans: Sequence[Float[np.ndarray, " T"]],
    rates: Rates,
    directions: Mapping[str, ParameterDirection],
    settings: Settings | None,
    samples: int,
) -> tuple[Float[np.ndarray, "spans p joints 2 samples"] | None, RESULTS]:
    """Make one run from `state` at `start_time`, s, to the end of the last span. Return derivatives
    of the depths that wear off in several spans of time, and the run's result code.

    The derivatives are (spans, p, joints, 2, samples), bearing before journal, at `samples` angles,
    m per unit of each parameter's coordinate; ``None`` if the run failed. `spans`: times of each
    span, from `quadrature_times`; `rates`: wear rates; `directions`: result of `directions_of`.
    """
    # Spans that follow each other share a time, which `unique` takes once.
    times = np.unique(np.concatenate(spans))
    outputs = {f"{joint} {name}": Signal(joint, name) for joint in rates for name in SIGNALS}
    parameters = {name: Parameter.change(along, 0.0) for name, along in directions.items()}
    run = sensitivities(
        scene,
        state,
        times[-1],
        parameters,
        outputs,
        times,
        settings,
        start_time=start_time,
        throw=False,
        progress=False,
    )
    if run.result != RESULTS.successful:
        return None, run.result
    derivatives = np.zeros((len(spans), len(directions), len(rates), len(PARTS), samples))
    for i, span in enumerate(spans):
        rows = np.searchsorted(times, span)
        for j, (joint, of_parts) in enumerate(rates.items()):
            signals = {name: run.outputs[f"{joint} {name}"][rows] for name in SIGNALS}
            # The depths depend on a parameter through the numbers and profiles of the joint,
            # through the signals of the run (forces, sliding speeds and positions of the journal
            # over time), and through the wear rates. The tangents of these give that of the depths.
            for k, (parameter, along) in enumerate(directions.items()):
                element, element_tangent = jax.jvp(
                    lambda value, j=joint, a=along: a(scene, state, value)[0].joints[j],
                    (0.0,),
                    (1.0,),
                )
                signal_tangents = {n: run.derivatives[f"{joint} {n}"][rows, k] for n in SIGNALS}
                # The derivative of a rate by its own logarithm is the rate itself. Other parameters
                # do not change the rates.
                is_own = np.array([rate_name(joint, part) == parameter for part in PARTS])
                rate_tangents = np.asarray(of_parts) * is_own
                _, derivatives[i, k, j] = jax.jvp(
                    lambda element, rates, signals, span=span: depths_from_signals(
                        element, rates, span, signals, samples
                    ),
                    (element, np.asarray(of_parts), signals),
                    (element_tangent, rate_tangents, signal_tangents),
                )
    return derivatives, run.result
