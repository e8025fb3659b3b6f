"""Derivatives of quantities along a motion with respect to parameters, with error control.

`studies.speed_accuracy` measures the accuracy, and `studies.benchmark` the cost.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import jax
import numpy as np
from jaxtyping import Float, Int
from typing_extensions import override

from ..._export import datasets
from ..._fields.cautions import UnusualValueWarning, caution
from ..._fields.checks import require
from ..._fields.types import ArrayLike
from ..._math.vectors import pack
from ..._model.bodies import State
from ..._model.scene import Scene
from ..._parametrisation.parameter import Parameter, check_parameters, coordinates_of
from ..._parametrisation.parametrised_scene import parametrised
from ..._parametrisation.readings import in_scene, sensor_errors, with_sensor_errors
from ..._parametrisation.variations import SeriesDelay
from ..._result_codes import RESULTS
from ..reductions.base import AbstractReduction
from ..results.impact_table import Impacts
from ..results.solution import Trajectory, raise_failure
from ..step import presets
from ..step.settings import Settings, check_span, checked_times, settings_or
from .host_run import IMPACTS
from .impact_recorder import impact_rows_of
from .outputs import EXAMPLE, Output, Requested, requested_by
from .run_checks import derivative_scheme
from .sampling import Sampled, TangentRun, recorded_run
from .saving import Saving
from .terminal import compiling_bar

if TYPE_CHECKING:
    import xarray as xr

WITH_DERIVATIVES = "in a run with derivatives"
FOR_REDUCTIONS = (
    "take simulate() or sweep() for it; cj.statistics_derivatives differentiates its mean"
)


@dataclass(frozen=True)
class Sensitivities(datasets.AbstractTabular):
    """Values of quantities at N times of a motion, and derivatives with respect to p parameters.

    - `parameters`: the p names of the parameters.
    - `times`: (N,) s, the requested times that the run reached.
    - `outputs[name]`: (N,), the values of the quantity of this name, in its unit; `Crossings` for a
      `Section`, and `Impacts` for an `ImpactTable`.
    - `derivatives[name]`: (N, p), derivatives of a quantity, in the order of `parameters`. They are
      with respect to the coordinates of the parameters' scales: for a parameter with the scale
      `Log`, with respect to its natural logarithm.
    - `saved`: the `Trajectory` at `Saving.times`, ``None`` unless requested.
    - `time`: s, end of the run; `result`: its `RESULTS` code; `attempts`, `accepted`: numbers of
      steps tried and accepted, added up over the several runs that more than 16 parameters need.
    - `impacts`: table of impacts, ``None`` unless requested; `settings`: pairs of name and value.
    - `units[name]`: unit of each quantity that declares one.
    - `scales`: (p,) labels of the parameters' coordinates, such as "log clearance".

    >>> found = cj.sensitivities(scene, state, 0.3, {"stiffness": stiffness}, {"x": x}, times)
    >>> found.outputs["x"].shape, found.derivatives["x"].shape
    ((30,), (30, 1))
    """

    parameters: tuple[str, ...]
    times: np.ndarray
    outputs: dict[str, Any]
    derivatives: dict[str, np.ndarray]
    time: float
    result: RESULTS
    attempts: int
    accepted: int
    saved: Trajectory | None = None
    impacts: Impacts | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    scales: tuple[str, ...] = ()
    settings: datasets.Notes = ()

    @override
    def to_xarray(self) -> "xr.Dataset":
        """Return quantities and their derivatives as an `xarray.Dataset`.

        - Each quantity is a variable of the same name along "time", in the quantity's unit.
        - Its derivatives are the variable "<name>_derivative" along "time" and "parameter". The
          parameters' coordinates are pure numbers (for the scale `Linear`, the value divided by the
          scale's `unit`), so that derivatives have the quantity's unit.
        - "coordinate" has the labels of the parameters' coordinates, such as "log clearance".
        - Attributes are the end of the run, s, its result, the numbers of steps, and the settings.

        **Raises:** `ValueError` if a quantity is named "time" or as one of these variables.
        """
        variables = {}
        for name, derivatives in self.derivatives.items():
            unit, slope = self.units.get(name), f"{name}_derivative"
            expected, remedy = "one that names no derivative of another output", "rename it"
            require(slope not in self.derivatives, "outputs", slope, expected, remedy)
            description = f"derivative of {name} by a parameter's coordinate"
            variables[name] = datasets.Labelled(("time",), self.outputs[name], unit)
            variables[slope] = datasets.Labelled(
                ("time", "parameter"), derivatives, unit, description
            )
        labels = {
            "time": datasets.Labelled(("time",), self.times, "s", "time"),
            "parameter": datasets.Labelled(("parameter",), datasets.texts(self.parameters)),
        }
        if self.scales:
            labels["coordinate"] = datasets.Labelled(("parameter",), datasets.texts(self.scales))
        notes = {
            "result": RESULTS[self.result],
            "time_reached": self.time,
            "attempts": self.attempts,
            "accepted": self.accepted,
            **dict(self.settings),
        }
        return datasets.labelled_dataset("sensitivities", variables, labels, tuple(notes.items()))


def sensitivities(
    scene: Scene,
    state: State,
    end_time: float,
    parameters: Mapping[str, Parameter],
    outputs: Mapping[str, Output],
    times: ArrayLike,
    settings: Settings | None = None,
    save: Saving | None = None,
    *,
    start_time: float = 0.0,
    throw: bool = True,
    progress: bool = True,
) -> Sensitivities:
    """Integrate a scene together with the derivatives of its motion with respect to parameters.

    Differentiating an adaptive solver would give the derivatives of its computed steps, which near
    impacts differ from those of the exact motion. Here, instead, the variational equations are
    integrated together with the state, under the same error control, and the entry speed of a
    contact is differentiated at the true time of the onset.

    At points where the equations of motion are not differentiable, the derivatives follow
    conventions. At a centred journal, and at zero penetration, they are the derivatives of free
    flight. At zero slip velocity they are those of one side of the friction law. At zero entry
    speed they use the damping at the law's `entry_speed_floor`, which replaces lower speeds.

    Derivatives with respect to the initial position of a journal that starts deeper than 1e-12 m in
    the wall, without an entry speed in the state, are meaningless: such a contact counts as
    elastic, so that the motion is a discontinuous function of this position.

    **Arguments:**

    - `scene`, `state`, `start_time`, `end_time`, `throw`: as in `simulate`, with `Sensitivities` in
      place of the `Solution`.
    - `parameters`: the p `Parameter`s to differentiate with respect to, by names of your choice.
      The run is computed at their values, by default the numbers in `scene` and `state`. Errors of
      sensors, such as `Parameter.bias("x")`, change the values of the output "x".
    - `outputs`: as in `simulate`, by names of your choice: quantities, scalar functions of an
      `Instant` such as those of `clearjoint.quantities`, which are differentiated, and sections and
      tables of impacts, which are not. Reductions such as `Peak` cannot be computed.
    - `times`: (N,) s, not decreasing, between start and end, at which quantities are evaluated.
    - `settings`: tolerances, solver and coordinates; `clearjoint.presets.derivatives` unless given.
    - `save`: states at given times, and impacts; the states after every step cannot be saved.
    - `progress`: show the time spent compiling.

    **Raises:** `ValueError` for invalid arguments, and for a joint, driver or force that may jump
    or have a kink at some time (it compares, rounds or clips a number that depends on time) but
    declares no `breakpoints`, because derivatives would lack the effect of a shift of these times;
    `SimulationError` for a run that fails, if `throw` is true. Its result is `RESULTS.force_jumped`
    if the force of a user-defined class jumps at a time that depends on the motion, or the torque
    of a torsional spring, bushing or motor at half a revolution, or the force of a spring between
    two points that pass each other.

    **Warns:** `UnusualValueWarning` for a journal that starts deep in the wall of its bearing, and
    for derivatives so much larger in an impact than after it that a loose `rtol` may spoil them.

    >>> found = cj.sensitivities(scene, state, 0.3, {"stiffness": stiffness}, {"x": x}, times)
    >>> exact = -0.5 * times * np.sin(10.0 * times)  # d x/d log k
    >>> bool(np.allclose(found.derivatives["x"][:, 0], exact, atol=1e-6))
    True
    """
    requested = _checked_outputs(outputs, save)
    check_parameters(parameters)
    for parameter in parameters.values():
        if isinstance(parameter.variation, SeriesDelay):
            # This raises an error, because here all outputs are evaluated at the same times. The
            # error says which calls can delay a single series.
            parameter.variation.setter(scene, state, 0.0)
    settings = settings_or(settings, presets.derivatives)
    check_span(start_time, end_time)
    scheme = derivative_scheme(scene, state, settings, start_time)
    sample_times = checked_times(start_time, end_time, times)
    requested.check(scene, settings.ledger)
    save, quantities = requested.save, requested.quantities
    saved = save.times_between(scene, start_time, end_time) if save.states else None
    # One run serves both requests: quantities and states are evaluated at the times of both, and
    # selected afterwards.
    all_times = sample_times if saved is None else np.union1d(sample_times, saved)
    sensors = sensor_errors(parameters, quantities)
    coordinates = coordinates_of(scene, state, parameters)
    family = parametrised(scene, state, in_scene(parameters), coordinates)
    run_arguments = scheme, family, quantities, all_times, (start_time, end_time), settings
    wanted = TangentRun.of(*run_arguments, requested.recorders(), has_states=saved is not None)
    with compiling_bar(progress):
        run = recorded_run(wanted, save.impacts)
        values, derivatives = run.values, run.derivatives
        if sensors.errors:
            elapsed = np.asarray(wanted.times) - start_time
            without_errors = values, derivatives, elapsed, coordinates
            values, derivatives = with_sensor_errors(sensors, *without_errors)
    rows = _reached_rows(run, all_times, sample_times)
    states, impacts = None, None
    if saved is not None:
        saved_rows = _reached_rows(run, all_times, saved)
        states = pack(jax.tree.map(lambda leaf: leaf[saved_rows], run.states))
        states = Trajectory(saved[: len(saved_rows)], states)
    if save.impacts:
        impacts = Impacts.of_rows(impact_rows_of(run.records[IMPACTS], start_time))
    result = Sensitivities(
        parameters=tuple(parameters),
        times=sample_times[: len(rows)],
        outputs={name: np.asarray(row)[rows] for name, row in values.items()}
        | requested.recorded(run.records, start_time),
        derivatives={name: np.asarray(row)[rows] for name, row in derivatives.items()},
        time=float(run.time),
        result=run.result,
        attempts=int(run.attempts),
        accepted=int(run.accepted),
        saved=states,
        impacts=impacts,
        units={n: q.unit for n, q in quantities.items() if getattr(q, "unit", None)},
        scales=tuple(p.scale.label(name) for name, p in parameters.items()),
        settings=datasets.setting_notes(vars(settings)),
    )
    _caution_amplified(np.asarray(run.amplification), result.parameters, settings)
    if throw:
        raise_failure(result, _growth_of_derivatives(result))
    return result


def _checked_outputs(outputs: Mapping[str, Output], save: Saving | None) -> Requested:
    requested = requested_by(outputs, save)
    require(len(outputs) > 0, "outputs", {}, "not empty", EXAMPLE)
    expected = f"a quantity, a Section or an ImpactTable {WITH_DERIVATIVES}"
    requested.refuse(AbstractReduction, expected, FOR_REDUCTIONS)
    requested.save.require_none(["steps"], WITH_DERIVATIVES, "take simulate() for them")
    return requested


def _reached_rows(
    run: Sampled, all_times: Float[np.ndarray, " N"], times: Float[np.ndarray, " some"]
) -> Int[np.ndarray, " reached"]:
    """Return the indices in `all_times`, in rising order, of the `times` that the run reached."""
    rows = np.searchsorted(all_times, times)
    return rows[run.reached[rows]]


AMPLIFIED = 1.0
"""Product of the tolerance of derivatives and `Sampled.amplification` above which `sensitivities`
warns. For a fall of 50 m onto stiff ground, derivatives were wrong by 5 to 30 % at products of 3 to
20, and by less than 1e-4 at 0.02."""


def _caution_amplified(
    amplification: np.ndarray, names: tuple[str, ...], settings: Settings
) -> None:
    # In a short and stiff impact, derivatives of speeds grow and decrease again by many orders of
    # magnitude. Their error at the peak remains, and may be larger than what follows.
    tolerance = settings.rtol * settings.derivative_tolerance
    # A controller of the user's has its own tolerances, which are unknown here. A tolerance of one
    # or more asks for derivatives without control of their errors.
    if settings.controller is not None or tolerance >= 1.0:
        return
    for name, factor in zip(names, amplification, strict=True):
        if tolerance * factor > AMPLIFIED:
            # With a product of 0.02, errors were below 1e-4 (see `AMPLIFIED`).
            tight = 0.02 * settings.rtol / (tolerance * factor)
            caution(
                f"The derivatives by {name!r} may be wrong by percents: in an impact, those of "
                f"speeds were {factor:.1g} times as large as what followed, and were computed to "
                f"{tolerance:.1g} of their size: tighten `rtol` to {tight:.0e}.",
                UnusualValueWarning,
            )


GROWN = 1e6
"""Factor by which derivatives grow in a run that fails, above which their growth counts as the
cause. Along a regular motion, derivatives grow about as the time or its square."""


def _growth_of_derivatives(run: Sensitivities) -> str | None:
    """Return a message if a run failed because derivatives grew `GROWN` times, else ``None``."""
    stuck = [RESULTS.max_steps_reached, RESULTS.step_too_small]
    # The largest growth of any derivative, by quantity and parameter.
    growth = 1.0
    for rows in run.derivatives.values():
        for column in np.abs(rows.T):
            sizes = column[column > 0.0]
            # The peak over the peak in the first tenth of the samples, rounded up to whole samples.
            if sizes.size:
                growth = max(growth, sizes.max() / sizes[: -(-sizes.size // 10)].max())
    if not any(run.result == code for code in stuck) or growth < GROWN:
        return None
    return (
        f"derivatives have grown by a factor of {growth:.1g}, which takes ever shorter steps. "
        "Impacts make the motion so sensitive that beyond a horizon its derivatives describe no "
        "finite change of a parameter. End the run earlier: cj.fit_horizon tells how long a record "
        "a fit can use. Later, only statistics of the motion vary smoothly: differentiate them by "
        "cj.statistics_derivatives."
    )
