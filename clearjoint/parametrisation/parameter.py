"""Parameters of a scene that are estimated, and the family of scenes that they span."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..fields.checks import require, require_names
from ..model.bodies import State
from ..model.scene import Scene
from .paths import Place, value_at
from .scales import AbstractScale, Linear
from .variations import (
    AbstractVariation,
    Change,
    MadeByFunction,
    SceneNumber,
    SeriesDelay,
    StateNumber,
)


@dataclass(frozen=True, init=False)
class Parameter:
    """A number of the scene that is estimated, and the scale on which.

    **Arguments:**

    - `place`: where in the scene it is, such as ``lambda scene: scene.joints["pin"].clearance``. A
      place that returns several numbers ties them.
    - `scale`: `Linear()` unless given; `Log()` for what is positive, `Bounded(low, high)` for
      what is between bounds. Derivatives are with respect to the scale's coordinate.
    - `value`: that of the scene unless given.
    - `unit`: a label; that of the place unless given.

    `Parameter.initial` takes a place in the initial state, `Parameter.change` a function that makes
    scene and state of a value, and `Parameter.delay` the names of measured series whose clock is
    late.

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
        place: Place | AbstractVariation,
        scale: AbstractScale | None = None,
        *,
        value: float | None = None,
        unit: str | None = None,
    ):
        variation = place if isinstance(place, AbstractVariation) else SceneNumber(place, unit)
        kind = scale if isinstance(scale, type) else type(scale)
        remedy = "pass for example cj.Log() or cj.Bounded(0.0, 1.0)"
        fine = isinstance(scale, AbstractScale | None)
        require(fine, "scale", kind.__name__, "a scale, such as Linear(), or None", remedy)
        object.__setattr__(self, "variation", variation)
        object.__setattr__(self, "scale", Linear() if scale is None else scale)
        object.__setattr__(self, "value", value)

    @staticmethod
    def initial(
        place: Place,
        scale: AbstractScale | None = None,
        *,
        value: float | None = None,
        unit: str | None = None,
    ) -> "Parameter":
        """A number of the initial state."""
        return Parameter(StateNumber(place, unit), scale, value=value)

    @staticmethod
    def change(
        make: Change, value: float, scale: AbstractScale | None = None, unit: str = "1"
    ) -> "Parameter":
        """A value from which ``make(scene, state, value)`` makes scene and state."""
        return Parameter(MadeByFunction(make, unit), scale, value=value)

    @staticmethod
    def delay(*series: str, value: float = 0.0, scale: AbstractScale | None = None) -> "Parameter":
        """The delay, s, by which the time stamps of measured series are late: a sample at time t is
        compared with the motion at t - delay. It is for fits, by `identify`, `identify_many` and
        `minimise`.

        **Arguments:**

        - `series`: names in `Measurements`, at least one; several share one clock.
        - `value`: first guess, s.
        - `scale`: `Linear()` unless given; `Bounded(-1e-3, 1e-3)` keeps the delay within 1 ms.

        A sample that the delay moves to before the start of the run is compared with the initial
        state: leave such samples out by `Measurements.between`. A delay common to all series can be
        told from the motion only if the motion depends on more than the time since its start, or if
        the initial state is known.

        >>> delay = cj.Parameter.delay("probe x", "probe y")
        >>> delay.value
        0.0
        """
        remedy = 'pass their names in the measurements, such as Parameter.delay("probe")'
        named = len(series) > 0 and all(isinstance(name, str) for name in series)
        require(named, "series", series, "names of series", remedy)
        return Parameter(SeriesDelay(series), scale, value=value)

    def coordinate_in(self, scene: Scene, state: State) -> float:
        """The coordinate of `value`, or if it is ``None`` of the value that stands in the scene.

        **Raises:** `ValueError` for a value outside the scale.
        """
        value = self.value
        if value is None and isinstance(self.variation, SceneNumber):
            value = value_at(scene, self.variation.place)
        elif value is None and isinstance(self.variation, StateNumber):
            value = value_at(state, self.variation.place)
        assert value is not None
        return self.scale.coordinate(value)


PASS_PARAMETERS = 'pass {"clearance": cj.Parameter(lambda scene: scene.joints["pin"].clearance)}'


def check_parameters(parameters: Mapping[str, Parameter]) -> None:
    """Check for a dictionary of parameters by name.

    **Raises:** `ValueError` that names the entry.
    """
    require_names("parameters", parameters, PASS_PARAMETERS)
    for name, parameter in parameters.items():
        kind, fine = type(parameter).__name__, isinstance(parameter, Parameter)
        require(fine, f"parameters[{name!r}]", kind, "a Parameter", PASS_PARAMETERS)


def coordinates_of(scene: Scene, state: State, parameters: Mapping[str, Parameter]) -> np.ndarray:
    """Coordinates (p,) of the parameters' values; see `Parameter.coordinate_in`."""
    return np.array([p.coordinate_in(scene, state) for p in parameters.values()])
