"""Derivatives of the wear of some cycles with respect to parameters.

`clearjoint.wear` computes wear in stages: each is a run of some cycles, extrapolated over many,
after which the profiles are changed. A parameter changes the wear of a stage directly, and through
the depths that were worn off in the stages before. One run with derivatives
(`clearjoint.sensitivities`) includes both effects: each of its parameters moves a number of the
scene and, at the same time, moves the profiles along the derivatives of their depths.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

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

Part = Literal["bearing", "journal"]
PARTS: tuple[Part, Part] = ("bearing", "journal")
PROFILES = tuple(f"{part}_profile" for part in PARTS)
Rates = Mapping[str, tuple[float, float]]
"""Specific wear rates of bearing and journal, m^2/N, by name of the joint."""


class MovingSpline(AbstractPeriodicSpline):
    """A worn profile that p parameters move: a periodic spline with N knots.

    The coefficients of the spline are `coefficients` plus, for each parameter, its shift times its
    directions.

    - `coefficients`: (N,) m, as in `PeriodicSpline`.
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
        """Return the four coefficients from the one before a knot to the second after it, (..., 4)
        m, moved by the shifts. `knot`: index of the knot, or an array (...) of indices."""
        found, count = periodic(on_device(self.coefficients), knot), self.angles()
        for k in range(np.shape(self.shifts)[0]):
            row = on_device(self.directions)[k * count : (k + 1) * count]
            found = found + self.shifts[k] * periodic(row, knot)
        return found

    @override
    def angles(self) -> int:
        """Return the number of knots."""
        return np.shape(self.coefficients)[0]


@dataclass(frozen=True)
class ParameterDirection:
    """A `Change` by which one parameter moves a number and all profiles that wear.

    It is called with a scene, a state and a value, and returns the changed scene and state. The
    value is the distance from the present coordinate of the parameter.

    - `index`: place of the parameter in the `shifts` of each `MovingSpline`.
    - `joints`: names of the joints that wear.
    - `change`: how the parameter's value changes the scene and the state; ``None`` for a wear rate.
      A run depends on wear rates only through the profiles.
    - `scale`: of the parameter, which converts a coordinate to a value; ``None`` for a wear rate.
    - `coordinate`: present coordinate of the parameter.
    """

    index: int
    joints: tuple[str, ...]
    change: Change | None = None
    scale: AbstractScale | None = None
    coordinate: float = 0.0

    def __call__(self, scene: Scene, state: State, value: Scalar) -> tuple[Scene, State]:
        """Return the pair (scene, state) at a distance `value` from the present coordinate: with
        the number changed, and the shifts of all profiles that wear."""
        scene, state = self.without_profiles(scene, state, value)
        for name in self.joints:
            for field in PROFILES:
                # A part that doesn't wear has a profile of another class, which doesn't move.
                profile = getattr(scene.joints[name], field)
                if isinstance(profile, MovingSpline):
                    scene = eqx.tree_at(
                        lambda s, n=name, f=field: getattr(s.joints[n], f).shifts,
                        scene,
                        on_device(profile.shifts).at[self.index].add(value),
                    )
        return scene, state

    def without_profiles(self, scene: Scene, state: State, value: Scalar) -> tuple[Scene, State]:
        """Return the pair (scene, state) with the number changed, but not the profiles.

        **Arguments:** `value`: distance from the present coordinate. For a wear rate it has no
        effect.
        """
        if self.change is None or self.scale is None:
            return scene, state
        return self.change(scene, state, self.scale.value(self.coordinate + value))


def directions_of(
    scene: Scene, state: State, rates: Rates, parameters: Mapping[str, Parameter]
) -> dict[str, ParameterDirection]:
    """Return a `ParameterDirection` for each parameter and for the logarithm of each positive wear
    rate, by name.

    A wear rate has the name of its joint and part, such as "pin bearing rate". Parameters come
    first, then wear rates; the index of each direction is its place in this order.

    **Arguments:** `scene`: with a `MovingSpline` for each profile that wears, which has one shift
    for each direction; the directions fit only scenes of this structure. `state`: the initial
    state. `rates`: of all joints that wear. `parameters`: by name.

    **Raises:** `ValueError` for a parameter that does not fit the scene and the state, or that has
    the name of a wear rate.
    """
    joints = tuple(rates)
    found: dict[str, ParameterDirection] = {}
    for name, parameter in parameters.items():
        # The example of a value, 0.0, says that the number is a scalar.
        change = parameter.variation.setter(scene, state, 0.0)
        coordinate = float(parameter.coordinate_in(scene, state))
        index, scale = len(found), parameter.scale
        found[name] = ParameterDirection(index, joints, change, scale, coordinate)
    for joint, of_parts in rates.items():
        for part, rate in zip(PARTS, of_parts, strict=True):
            if rate > 0.0:
                name = rate_name(joint, part)
                expected = "named otherwise than the logarithm of a wear rate"
                require(name not in parameters, "parameters", name, expected, "rename it")
                found[name] = ParameterDirection(len(found), joints)
    return found


def rate_name(joint: str, part: str) -> str:
    """Return the name of the parameter that is the logarithm of a wear rate, such as
    "pin bearing rate" for the joint "pin" and the part "bearing"."""
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
    """Return the derivatives of the depths that wear off in several spans of time of a run.

    A new run is computed, from `start_time`, s, to the last time in `spans`.

    **Arguments:**

    - `scene`: with `MovingSpline`s as the profiles of bearings and journals that wear.
    - `state`: at `start_time`.
    - `spans`: for each span, the times, (T,) s, at which its wear is integrated by Simpson's rule;
      from `quadrature_times`.
    - `rates`: specific wear rates of bearing and journal, m^2/N, by the names of the J joints.
    - `directions`: of the p parameters, which include the logarithms of wear rates, by name; from
      `directions_of`.
    - `settings`: of the run; by default `clearjoint.presets.derivatives`.
    - `samples`: number of evenly spaced angles around the wall, and around the journal.

    **Returns:** the derivatives, (spans, p, J, 2, samples), bearing before journal, m per unit of
    each parameter's coordinate, or ``None`` if the run failed; and the result code of the run.
    """
    # Spans that follow each other share a time.
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
            signals = {name: run.values[f"{joint} {name}"][rows] for name in SIGNALS}
            # The depths depend on a parameter through the numbers and profiles of the joint,
            # through the signals of the run (forces, sliding speeds and positions of the journal
            # over time), and through the wear rates.
            for k, (parameter, along) in enumerate(directions.items()):
                element, element_along = jax.jvp(
                    lambda value, j=joint, a=along: a(scene, state, value)[0].joints[j],
                    (0.0,),
                    (1.0,),
                )
                signals_along = {n: run.derivatives[f"{joint} {n}"][rows, k] for n in SIGNALS}
                names = (rate_name(joint, part) for part in PARTS)
                # The derivative of a rate by its own logarithm is the rate itself.
                rates_along = [
                    rate * (name == parameter) for rate, name in zip(of_parts, names, strict=True)
                ]
                _, derivatives[i, k, j] = jax.jvp(
                    lambda element, rates, signals, span=span: depths_from_signals(
                        element, rates, span, signals, samples
                    ),
                    (element, np.asarray(of_parts), signals),
                    (element_along, np.asarray(rates_along), signals_along),
                )
    return derivatives, run.result
