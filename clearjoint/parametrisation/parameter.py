"""Parameters of a scene that a fit estimates."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..fields.checks import require, require_types
from ..model.bodies import State
from ..model.scene import Scene
from .paths import NumberPath, value_at
from .scales import AbstractScale, Linear
from .variations import (
    AbstractNumber,
    AbstractVariation,
    Change,
    MadeByFunction,
    SceneNumber,
    SeriesDelay,
    StateNumber,
)


@dataclass(frozen=True, init=False)
class Parameter:
    """A number of the scene that a fit estimates, and the scale of the estimate.

    A parameter may also be a number of the initial state (`Parameter.initial`), a value from which
    a function makes scene and state (`Parameter.change`), or the unknown delay of the time stamps
    of measured series (`Parameter.delay`).

    **Arguments:**

    - `path`: function that selects the number in a scene, such as
      ``lambda scene: scene.joints["pin"].clearance``, or an `AbstractVariation`. A path that
      returns several numbers ties them: they share one value.
    - `scale`: `Linear()` by default; `Log()` for positive numbers, `Bounded(low, high)` for
      numbers between bounds. A scale maps values to unbounded coordinates; the fit works in these
      coordinates, and derivatives are with respect to them.
    - `value`: first guess, SI; by default the value in the scene.
    - `unit`: text that labels the values and converts nothing; by default the SI unit of the number
      in the scene. An `AbstractVariation` has its own unit instead.

    **Raises:** `ValueError` for a path that is not a function, and for a scale of another type.

    >>> parameter = cj.Parameter(lambda scene: scene.joints["shoulder"].clearance, cj.Log())
    >>> scene, state = cj.mechanisms.double_pendulum(clearance=0.5e-3)
    >>> print(f"{parameter.coordinate_in(scene, state):.4f}")  # log(0.5e-3)
    -7.6009
    """

    variation: AbstractVariation
    scale: AbstractScale
    value: float | None

    def __init__(
        self,
        path: NumberPath | AbstractVariation,
        scale: AbstractScale | None = None,
        *,
        value: float | None = None,
        unit: str | None = None,
    ):
        variation = path if isinstance(path, AbstractVariation) else SceneNumber(path, unit)
        kind = scale if isinstance(scale, type) else type(scale)
        remedy = "pass for example cj.Log() or cj.Bounded(0.0, 1.0)"
        fine = isinstance(scale, AbstractScale | None)
        require(fine, "scale", kind.__name__, "a scale, such as Linear(), or None", remedy)
        object.__setattr__(self, "variation", variation)
        object.__setattr__(self, "scale", Linear() if scale is None else scale)
        object.__setattr__(self, "value", value)

    @staticmethod
    def initial(
        path: NumberPath,
        scale: AbstractScale | None = None,
        *,
        value: float | None = None,
        unit: str | None = None,
    ) -> "Parameter":
        """Return a parameter that is a number of the initial state.

        **Arguments:** `path`: function that selects the number in a `State`, such as
        ``lambda state: state.bodies["arm"].spin[2]``. The others, and the errors, are as in
        `Parameter`.
        """
        return Parameter(StateNumber(path, unit), scale, value=value)

    @staticmethod
    def change(
        make: Change, value: float, scale: AbstractScale | None = None, unit: str = "1"
    ) -> "Parameter":
        """Return a parameter whose value enters the scene and the initial state through a function.

        **Arguments:**

        - `make`: function that receives the scene, the initial state and a value, and returns the
          changed pair (scene, state).
        - `value`: first guess, in `unit`; required, because the scene has no such number.
        - `scale`: as in `Parameter`. `unit`: text that labels the value.

        **Raises:** `ValueError` if `make` is not a function, and for a scale of another type.
        """
        return Parameter(MadeByFunction(make, unit), scale, value=value)

    @staticmethod
    def delay(*series: str, value: float = 0.0, scale: AbstractScale | None = None) -> "Parameter":
        """Return a parameter that is the delay, s, of the time stamps of measured series.

        A sample at time t is compared with the motion at t - delay. Fits by `identify`,
        `identify_many` and `minimise` accept delays.

        **Arguments:**

        - `series`: names in `Measurements`, at least one; several series share one clock.
        - `value`: first guess, s.
        - `scale`: `Linear()` by default; `Bounded(-1e-3, 1e-3)` keeps the delay within 1 ms.

        A sample whose time less the delay is before the start of the run is compared with the
        initial state: leave out these samples by `Measurements.between`. A delay common to all
        series is identifiable only if the initial state is known, or if the motion depends on
        time itself, for example by a driver, and not only on the time since its start.

        **Raises:** `ValueError` without names, and for a scale of another type.

        >>> delay = cj.Parameter.delay("probe x", "probe y")
        >>> delay.value
        0.0
        """
        remedy = 'pass their names in the measurements, such as Parameter.delay("probe")'
        named = len(series) > 0 and all(isinstance(name, str) for name in series)
        require(named, "series", series, "names of series", remedy)
        return Parameter(SeriesDelay(series), scale, value=value)

    def coordinate_in(self, scene: Scene, state: State) -> float:
        """Return the coordinate of `value` on the parameter's scale.

        If `value` is ``None``, the result is the coordinate of the number in the scene or state.

        **Raises:** `ValueError` for a value that the scale doesn't allow, and for a path that leads
        to no number.
        """
        value = self.value
        if value is None and isinstance(self.variation, AbstractNumber):
            value = value_at(self.variation.tree(scene, state), self.variation.path)
        assert value is not None
        return self.scale.coordinate(value)


PASS_PARAMETERS = 'pass {"clearance": cj.Parameter(lambda scene: scene.joints["pin"].clearance)}'


def check_parameters(parameters: Mapping[str, Parameter]) -> None:
    """Check that `parameters` is a dictionary of `Parameter` by name.

    **Raises:** `ValueError` that names the wrong entry.
    """
    require_types("parameters", parameters, Parameter, "a Parameter", PASS_PARAMETERS)


def step_limits(parameters: Mapping[str, Parameter]) -> np.ndarray:
    """Return the largest change of each parameter's coordinate in one step of a fit, (p,).

    The limit is `AbstractScale.max_step`; it may be infinite.
    """
    return np.array([parameter.scale.max_step for parameter in parameters.values()])


def values_at(
    parameters: Mapping[str, Parameter], coordinates: Float[np.ndarray, " p"]
) -> dict[str, float]:
    """Return the value of each parameter by name at coordinates (p,)."""
    pairs = zip(parameters.items(), coordinates, strict=True)
    return {name: float(parameter.scale.value(u)) for (name, parameter), u in pairs}


def coordinates_of(scene: Scene, state: State, parameters: Mapping[str, Parameter]) -> np.ndarray:
    """Return the coordinates of all parameters, (p,), each from `Parameter.coordinate_in`."""
    return np.array([p.coordinate_in(scene, state) for p in parameters.values()])
