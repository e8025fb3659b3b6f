"""Looks at one value of a parameter: the margins there, with their derivatives."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from ...fields.checks import require, require_count
from ...model.bodies import State
from ...model.scene import Scene
from ...parametrisation.parameter import Parameter
from ...quantities.base import Quantity
from ...results import RESULTS
from ...simulation.sensitivities import Sensitivities, sensitivities
from ...simulation.settings import Settings
from .margins import Margins, margins_of

NEIGHBOURS = 20
"""Instants on either side of a peak, of those taken closely round it, that say where it is."""
SAMPLES = 4000
"""Instants at which a run takes its outputs unless told otherwise."""


def margins(
    scene: Scene,
    state: State,
    end_time: float,
    parameter: Parameter,
    quantities: Mapping[str, Quantity],
    limits: Mapping[str, float],
    settings: Settings | None = None,
    *,
    value: float,
    after: float | None = None,
    start_time: float = 0.0,
    samples: int = SAMPLES,
) -> Margins:
    """Margins of quantities' peaks to their limits at a value of a parameter, with derivatives.

    Two runs: one that finds the peaks, and one that takes the quantities closely round them, since
    off a peak the derivative at a fixed time is not the peak's.

    ```python
    import clearjoint as cj

    scene, state = cj.slider_crank(0.1e-3)
    clearance = cj.Parameter(lambda scene: scene.joints["slider pin"].clearance, cj.Log())
    force = {"pin": cj.quantities.ContactForce("slider pin", "V")}
    found = cj.margins(
        scene, state, 2e-3, clearance, force, {"pin": 5e3}, value=0.1e-3, samples=500
    )
    ```

    **Arguments:**

    - `scene`, `state`, `start_time`, `end_time` s, `settings`: as in `sensitivities`.
    - `parameter`: what is changed, and the scale whose coordinate slopes are taken along; `value`:
      in the parameter's unit.
    - `quantities`: scalar functions of an `Instant` by name; `limits`: the largest value allowed
      of each, positive, in its unit.
    - `after`: s, from when on peaks count; from the start unless given.
    - `samples`: instants at which peaks are searched: ten for the shortest peak that matters.

    **Returns:** `Margins`.

    **Raises:** `ValueError` for arguments that no run can use.
    """
    require_count("samples", samples, "give a number of instants")
    check_limits(quantities, limits)
    begin = start_time if after is None else after
    place = parameter.scale.coordinate(value)
    changed = parameter.variation.setter(scene, state, value)(scene, state, value)

    def run(times: np.ndarray) -> Sensitivities:
        return sensitivities(
            *changed,
            end_time,
            {"parameter": Parameter(parameter.variation, parameter.scale, value=value)},
            quantities,
            times,
            settings,
            start_time=start_time,
            throw=False,
            progress=False,
        )

    coarse = run(np.linspace(begin, end_time, samples))
    if coarse.result != RESULTS.successful:
        return margins_of(coarse, place, limits)
    fine = run(times_round_peaks(coarse, tuple(limits)))
    return margins_of(fine, place, limits, NEIGHBOURS)


def times_round_peaks(run: Sensitivities, names: tuple[str, ...]) -> Float[np.ndarray, " N"]:
    """As many instants as the run has, within one of its intervals round the largest value of each
    output, s."""
    interval = run.times[1] - run.times[0]
    shifts = np.linspace(-interval, interval, len(run.times) // len(names))
    peaks = [run.times[np.argmax(run.values[name])] for name in names]
    return np.sort(np.clip(np.concatenate([peak + shifts for peak in peaks]), *run.times[[0, -1]]))


def check_limits(outputs: Mapping[str, object], limits: Mapping[str, float]) -> None:
    """Check that each output has a limit, and that it is positive."""
    remedy = "give each quantity one limit, under the same name"
    same = set(outputs) == set(limits)
    require(same, "limit", sorted(limits), f"one for each of {sorted(outputs)}", remedy)
    for name, limit in limits.items():
        fine = isinstance(limit, int | float | np.number) and 0.0 < float(limit) < np.inf
        remedy = "give the largest value allowed, of a magnitude or a distance"
        require(fine, f"limit[{name!r}]", limit, "a positive number", remedy)
