"""A quantity along a solution, with its name, times and unit."""

import re
from collections.abc import Callable

import numpy as np
import xarray as xr

from ..fields.checks import require
from ..model.scene import Scene
from ..quantities.base import AbstractQuantity, Quantity
from ..simulation.results.quantity_values import rates_along, values_along
from ..simulation.results.solution import Solution, Trajectory


def series(
    scene: Scene,
    solution: Solution,
    quantity: Quantity,
    *,
    unit: str | None = None,
    trajectory: Trajectory | None = None,
) -> xr.DataArray:
    """A quantity along a solution.

    **Arguments:**

    - `scene`: the one that was simulated. `solution`: with saved states.
    - `quantity`: one of `clearjoint.quantities`, or another scalar function of an `Instant`.
    - `unit`: its unit, SI, where it does not know its own.
    - `trajectory`: `solution.steps`, say, for every accepted step; the saved states unless given.

    **Returns:** (N,) over "time", s, with the name and the unit of the quantity.

    **Raises:** `ValueError` for a solution without states, and for a quantity without a unit.

    >>> save = cj.Saving(np.linspace(0, 0.5, 101))
    >>> solution = cj.simulate(scene, state, 0.5, save=save, progress=False)
    >>> found = plot.series(scene, solution, cj.quantities.Position("ball", "x"))
    >>> found.attrs["units"], np.allclose(found, 0.1 * np.cos(10.0 * found["time"]), atol=1e-6)
    ('m', True)
    """
    trajectory = trajectory_of(solution, trajectory)
    values = values_along(scene, solution, quantity, trajectory)
    return _labelled(
        np.asarray(trajectory.times), values, name_of(quantity), unit_of(quantity, unit)
    )


def rate_series(
    scene: Scene,
    solution: Solution,
    quantity: Quantity,
    *,
    unit: str | None = None,
    trajectory: Trajectory | None = None,
) -> xr.DataArray:
    """The rate of a quantity along a solution, from the equations of motion: for quantities that
    positions, velocities and the time decide.

    **Arguments**, **Returns**, **Raises:** as of `series`.

    >>> save = cj.Saving(np.linspace(0, 0.5, 101))
    >>> solution = cj.simulate(scene, state, 0.5, save=save, progress=False)
    >>> found = plot.rate_series(scene, solution, cj.quantities.Position("ball", "x"))
    >>> found.attrs["units"], np.allclose(found, -np.sin(10.0 * found["time"]), atol=1e-5)
    ('m/s', True)
    """
    trajectory = trajectory_of(solution, trajectory)
    rates = rates_along(scene, solution, quantity, trajectory)
    unit = unit_of(quantity, unit)
    times = np.asarray(trajectory.times)
    return _labelled(times, rates, f"rate of {name_of(quantity)}", _over_seconds(unit))


def trajectory_of(solution: Solution, trajectory: Trajectory | None) -> Trajectory:
    """The trajectory to look along: the given one, or the saved states of the solution."""
    found = solution.saved if trajectory is None else trajectory
    remedy = "pass save=Saving(times) to simulate(), or trajectory=solution.steps"
    require(found is not None, "solution", "without saved states", "one with states", remedy)
    assert found is not None
    return found


def name_of(quantity: Callable[..., object]) -> str:
    """What a label calls a quantity: its kind, and the names in it."""
    kind = getattr(quantity, "__name__", type(quantity).__name__)
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", kind).replace("_", " ").lower()
    if not isinstance(quantity, AbstractQuantity):
        return words.replace("<lambda>", "quantity")
    texts = [value for value in vars(quantity).values() if isinstance(value, str)]
    return " ".join([words, *([f"of {' '.join(texts)}"] if texts else [])])


def unit_of(quantity: Quantity, unit: str | None) -> str:
    """The unit of a quantity, SI: the given one, or its own."""
    own = getattr(quantity, "unit", None)
    found = own if unit is None else unit
    require(found is not None, "unit", unit, "an SI unit for this quantity", 'pass unit="m", say')
    assert found is not None
    return found


def _over_seconds(unit: str) -> str:
    if unit == "1":
        return "1/s"
    base, slash, power = unit.partition("/s")
    if not slash:
        return f"{unit}/s"
    return f"{base}/s^{int(power.removeprefix('^') or 1) + 1}"


def _labelled(times: np.ndarray, values: np.ndarray, name: str, unit: str) -> xr.DataArray:
    coordinate = xr.DataArray(times, dims="time", attrs={"units": "s"})
    return xr.DataArray(values, {"time": coordinate}, ("time",), name=name, attrs={"units": unit})
