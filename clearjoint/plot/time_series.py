"""Draw quantities and energies over time, phase portraits and amplitude spectra."""

import re
from collections.abc import Callable

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from scipy import signal

from .._fields.checks import errors_about, require, require_finite
from .._model.scene import Scene
from .._simulation.results.observe import Observation, values_along
from .._simulation.results.solution import Solution, Trajectory
from ..quantities.base import AbstractQuantity, Quantity
from . import style


def series(
    scene: Scene,
    solution: Solution,
    quantity: Quantity,
    *,
    unit: str | None = None,
    trajectory: Trajectory | None = None,
) -> xr.DataArray:
    """Return the values (N,) of a quantity at the saved states of a solution, or at the states of a
    `trajectory`, as an array with the coordinate "time", s, and with the unit in its
    ``attrs["units"]``. `unit`: SI unit of a quantity that declares none.

    >>> positions = plot.series(scene, swing, x)
    >>> np.allclose(positions, 0.1 * np.cos(10.0 * positions["time"]), atol=1e-6)
    True
    """
    trajectory = trajectory_of(solution, trajectory)
    values = values_along(scene, solution, quantity, trajectory)
    return labelled(trajectory, values, name_of(quantity), unit_of(quantity, unit))


def rate_series(
    scene: Scene,
    solution: Solution,
    quantity: Quantity,
    *,
    unit: str | None = None,
    trajectory: Trajectory | None = None,
) -> xr.DataArray:
    """Return the time derivative of a quantity; arguments and form of the result as for `series`.

    No differences of values are taken: the derivative follows from the velocities of each state,
    and from the accelerations that the equations of motion give for it. Entry speeds of contacts
    and deflections of bristles, on which a force may depend, count as constant.

    >>> rates = plot.rate_series(scene, swing, x)
    >>> np.allclose(rates, -np.sin(10.0 * rates["time"]), atol=1e-5)
    True
    """
    trajectory = trajectory_of(solution, trajectory)
    rates = values_along(scene, solution, quantity, trajectory, rates=True)
    unit = _over_seconds(unit_of(quantity, unit))
    return labelled(trajectory, rates, f"rate of {name_of(quantity)}", unit)


def trajectory_of(solution: Solution, trajectory: Trajectory | None) -> Trajectory:
    """Return `trajectory`, or if it is None the saved states of the solution, which must exist."""
    trajectory = solution.saved if trajectory is None else trajectory
    remedy = "pass save=Saving(times) to simulate(), or trajectory=solution.steps"
    require(trajectory is not None, "solution", "without saved states", "one with states", remedy)
    assert trajectory is not None
    return trajectory


def name_of(quantity: Callable[..., object]) -> str:
    """Return the name of a quantity for labels, such as "position of ball x": the words of its
    class, and its fields that are texts."""
    kind = getattr(quantity, "__name__", type(quantity).__name__)
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", kind).replace("_", " ").lower()
    if not isinstance(quantity, AbstractQuantity):
        return words.replace("<lambda>", "quantity")
    texts = [value for value in vars(quantity).values() if isinstance(value, str)]
    return " ".join([words, *([f"of {' '.join(texts)}"] if texts else [])])


def unit_of(quantity: Quantity, unit: str | None) -> str:
    """Return `unit`, or if it is None the SI unit that the quantity declares, which must exist."""
    declared = getattr(quantity, "unit", None)
    agrees = None in (declared, unit) or declared == unit
    require(agrees, "unit", unit, f"the quantity's own, {declared!r}", "leave it out")
    unit = declared if unit is None else unit
    require(unit is not None, "unit", unit, "an SI unit for this quantity", 'pass unit="m", say')
    assert unit is not None
    return unit


def _over_seconds(unit: str) -> str:
    # The unit of a rate: "m/s^2" for "m/s".
    if unit == "1":
        return "1/s"
    base, slash, power = unit.partition("/s")
    if not slash:
        return f"{unit}/s"
    return f"{base}/s^{int(power.removeprefix('^') or 1) + 1}"


def labelled(trajectory: Trajectory, values: np.ndarray, name: str, unit: str) -> xr.DataArray:
    """Return values (N,) at the N times of a trajectory as an array with name, unit and times."""
    coordinate = xr.DataArray(np.asarray(trajectory.times), dims="time", attrs={"units": "s"})
    return xr.DataArray(values, {"time": coordinate}, ("time",), name=name, attrs={"units": unit})


def phase_portrait(
    scene: Scene,
    solution: Solution,
    quantity: Quantity,
    *,
    unit: str | None = None,
    trajectory: Trajectory | None = None,
    window: style.TimeSpan | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Draw the time derivative of a quantity over the quantity itself: a closed curve for a
    periodic motion. A dot marks the start, a square the end. Angles continue beyond a full turn.
    The quantity must be a function of positions, such as an angle or a penetration. `unit` and
    `trajectory` are as for `series`.

    >>> axes = plot.phase_portrait(scene, swing, x)
    """
    values = series(scene, solution, quantity, unit=unit, trajectory=trajectory)
    rates = rate_series(scene, solution, quantity, unit=unit, trajectory=trajectory)
    period = getattr(quantity, "period", None)  # after which an angle begins again
    if period is not None:
        values = values.copy(data=np.unwrap(values.values, period=period))
    axes = style.axes_or_new(axes, (5.6, 4.4))
    in_window = style.inside(values["time"].values, window)
    x, y = style.scaled(values[in_window]), style.scaled(rates[in_window])
    axes.plot(x.values, y.values, color=style.BLUE, linewidth=0.9)
    for index, marker, label in ((0, "o", "start"), (-1, "s", "end")):
        if len(x.values):
            look = {"color": style.DARK, "markersize": 5, "linestyle": "", "zorder": 3}
            axes.plot(x.values[[index]], y.values[[index]], marker, label=label, **look)
    style.legend_above(axes, 2)
    return style.dress(axes, x.label, y.label)


FEWEST = 4
"""Smallest number of samples for a spectrum, which then has two frequencies."""


def amplitude_spectrum(record: xr.DataArray, taper: str = "hann") -> xr.DataArray:
    """Return the one-sided amplitude spectrum of values over time, less their mean. A harmonic of
    amplitude A has the value A at its frequency, if this is one of the spectrum's frequencies.

    **Arguments:**

    - `record`: array (N,) with the coordinate "time", s, at equal intervals, such as from `series`.
    - `taper`: name of a window function of `scipy.signal.get_window`: "hann"; "flattop", with the
      true amplitude also between two frequencies of the spectrum; or "boxcar", for a record of a
      whole number of periods.

    **Returns:** array (N // 2,) in the unit of the record, with the coordinate "frequency", Hz: k /
    (N h) for k from 1 to N // 2, with the sampling interval h.

    **Raises:** `ValueError` for fewer than four samples, unequal intervals, and an unknown `taper`.

    >>> import xarray as xr
    >>> times = np.arange(1000) / 1000.0
    >>> record = xr.DataArray(0.1 * np.cos(100.0 * np.pi * times), {"time": times})
    >>> amplitudes = plot.amplitude_spectrum(record)
    >>> float(amplitudes.idxmax()), round(float(amplitudes.max()), 6)
    (50.0, 0.1)
    """
    is_row = isinstance(record, xr.DataArray) and record.ndim == 1 and "time" in record.coords
    expected = 'an xarray.DataArray (N,) with the coordinate "time"'
    remedy = 'pass xr.DataArray(values, {"time": times})'
    require(is_row, "record", type(record).__name__, expected, remedy)
    times, remedy = record["time"].values, "save more states"
    require(len(times) >= FEWEST, "record", len(times), f"at least {FEWEST} samples", remedy)
    intervals = np.diff(times)
    shown = f"intervals from {intervals.min():.3g} to {intervals.max():.3g} s"
    remedy = "save states at equal intervals: Saving(np.linspace(0, end, count))"
    expected = "sampled at equal intervals of time"
    require(suits_spectrum(intervals), "record", shown, expected, remedy)
    values, rate = np.asarray(record.values, float), 1.0 / float(intervals.mean())
    require_finite("record", values)
    with errors_about("taper"):
        frequency, power = signal.periodogram(
            values, rate, taper, detrend="constant", scaling="spectrum"
        )
    # A harmonic of amplitude A has the mean square A² / 2, hence the factor 2. At the Nyquist
    # frequency, which only an even number of samples has, the mean square is A², because the
    # samples are A and -A in turn, hence the factor 1.
    factors = np.full(len(power), 2.0)
    if len(values) % 2 == 0:
        factors[-1] = 1.0
    # The first frequency is zero, at which nothing is left without the mean.
    coordinate = xr.DataArray(frequency[1:], dims="frequency", attrs={"units": "Hz"})
    where, attrs = {"frequency": coordinate}, {"units": record.attrs.get("units", "1")}
    amplitude = np.sqrt(factors * power)[1:]
    return xr.DataArray(amplitude, where, ("frequency",), name=record.name, attrs=attrs)


def suits_spectrum(intervals: np.ndarray) -> bool:
    """Return whether N samples suit a spectrum: N >= 4, and equal `intervals`, (N - 1,) s."""
    if len(intervals) + 1 < FEWEST:
        return False
    mean = float(intervals.mean())
    return mean > 0.0 and bool(np.ptp(intervals) <= 1e-6 * mean)


def spectrum(
    scene: Scene,
    solution: Solution,
    quantity: Quantity,
    *,
    unit: str | None = None,
    taper: str = "hann",
    axes: Axes | None = None,
) -> Axes:
    """Draw the amplitude spectrum of a quantity at the saved states of a solution, on a logarithmic
    scale. Vibrations above half the sampling rate, such as those of an impact, appear at wrong
    frequencies below half that rate (aliasing). `taper`: as in `amplitude_spectrum`.

    >>> axes = plot.spectrum(scene, swing, rate)
    """
    return spectrum_of(series(scene, solution, quantity, unit=unit), taper=taper, axes=axes)


def spectrum_of(record: xr.DataArray, *, taper: str = "hann", axes: Axes | None = None) -> Axes:
    """Draw the amplitude spectrum of values over time, such as measured ones, on a logarithmic
    scale, without amplitudes below 1e-8 of the largest. `record` and `taper` are those of
    `amplitude_spectrum`. A title names the taper and the distance of the frequencies.

    >>> axes = plot.spectrum_of(plot.series(scene, swing, x), taper="boxcar")
    """
    amplitudes = amplitude_spectrum(record, taper)
    axes = style.axes_or_new(axes)
    y = style.scaled(amplitudes.rename(amplitudes.name or "values"))
    frequencies = amplitudes["frequency"].values
    factor, unit = style.fitting_unit(frequencies, "Hz")
    axes.plot(frequencies * factor, y.values, color=style.BLUE, linewidth=0.9)
    times = record["time"].values
    half_rate = 0.5 * (len(times) - 1) / float(times[-1] - times[0])  # the Nyquist frequency, Hz
    # Rounding keeps a tick at the end, which rounding errors could put outside of the axis.
    axes.set_xlim(0.0, float(f"{half_rate * factor:.9g}"))
    largest = y.values.max(initial=0.0)
    if largest > 0.0:  # a constant record has no amplitudes to show on a logarithmic axis
        axes.set_yscale("log")
        # Amplitudes below 1e-8 of the largest are rounding errors, or spectral leakage.
        axes.set_ylim(max(0.5 * y.values.min(), 1e-8 * largest), 2.0 * largest)
    title = f"window: {taper}; lines {float(frequencies[0]):.3g} Hz apart"  # zero is left out
    axes.set_title(title, fontsize="small", loc="right")
    return style.dress(axes, f"frequency, {unit}", f"amplitude of {y.label}")


POTENTIAL = "potential, 0 at the start"
ENERGIES = {
    "kinetic": ("kinetic",),
    POTENTIAL: ("gravity",),
    "elastic": ("springs", "contacts", "bristles"),
    "dissipated": ("normal damping", "friction", "film", "stabilisation"),
    "work of drivers and loads": ("supplied",),
}
"""Keys of `Observation.energies` whose sum is one curve, by the curve's label in the legend."""


def energy_ledger(
    observation: Observation,
    *,
    window: style.TimeSpan | None = None,
    axes: np.ndarray | None = None,
) -> np.ndarray:
    """Draw the energies of a run over time, and below them the error of their balance, the drift.

    The upper axes show the kinetic energy, the potential energy of gravity relative to the first
    instant, the elastic energy (of springs, contacts, and bristles of friction laws), the energy
    dissipated since the start (by normal damping, friction, films, and the stabilisation of
    constraints) and the work of drivers and loads since the start.

    The drift is the change of the sum of kinetic, potential, elastic and dissipated energy minus
    the work, zero for an exact integration. A title relates it to the largest change of an energy
    over the whole run. Without ``Settings(ledger=True)``, dissipated energy and work are unknown:
    the lower axes then show the change of the mechanical energy.

    **Arguments:** `axes`: array (2,) of the upper and the lower axes, which is also returned.

    >>> above, below = plot.energy_ledger(observed)
    """
    if axes is None:
        looks = {"sharex": True, "height_ratios": (2.2, 1.0), "figsize": (6.4, 5.2)}
        axes = np.asarray(plt.subplots(2, 1, layout="constrained", **looks)[1])
    above, below = axes
    energies = observation.energies
    # Energies that the scene does not have, such as those of springs, are left out.
    changes = {
        label: np.sum([energies[name] for name in names if name in energies], axis=0)
        for label, names in ENERGIES.items()
        if not energies.keys().isdisjoint(names)
    }
    if POTENTIAL in changes:  # only its changes matter, and its zero is arbitrary
        changes[POTENTIAL] = changes[POTENTIAL] - changes[POTENTIAL][0]
    mask, times, time_label = style.time_axis(above, observation.times, window)
    curves = {name: values[mask] for name, values in changes.items()}
    factor, unit = style.fitting_unit(np.concatenate(list(curves.values())), "J")
    style.draw_lines(above, ((n, times, y * factor) for n, y in curves.items()), linewidth=1.8)
    above.margins(x=0.0)
    style.legend_above(above, min(len(curves), 3), handlelength=3.0)
    style.dress(above, "", f"energy, {unit}")
    style.time_axis(below, observation.times, window)
    drift = np.asarray(observation.ledger_residual())[mask]
    factor, unit = style.fitting_unit(drift, "J")
    below.plot(times, drift * factor, color=style.DARK, linewidth=1.0)
    below.margins(x=0.0)
    # Only a run with an energy ledger has these energies.
    has_ledger = not energies.keys().isdisjoint({*ENERGIES["dissipated"], "supplied"})
    # Over all times, because the energies may hardly change in a window, which inflates the share.
    largest_change = max(np.ptp(values) for values in changes.values())
    if has_ledger and largest_change > 0.0:  # a title tells how large the drift is relatively
        share = np.abs(drift).max(initial=0.0) / largest_change
        text = f"at most {share:.1g} of the largest change above"
        below.set_title(text, fontsize="small", loc="right")
    label = "drift" if has_ledger else "mechanical,\nsince start"
    style.dress(below, time_label, f"{label}, {unit}")
    return axes
