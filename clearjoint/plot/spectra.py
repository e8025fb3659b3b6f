"""Spectra of quantities: of one run, and of the lanes of a sweep."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from scipy import signal

from ..fields.checks import require
from ..model.scene import Scene
from ..quantities.base import Quantity
from ..simulation.solution import Solution
from .along import series
from .labels import ScaledValues, fitting_unit, scale_axes, scaled
from .maps import MISSING
from .outcomes import ended_well, only_axis, require_names
from .style import BLUE, axes_or_new, dress

DECADES, DECADES_OF_COLOUR = 8.0, 5.0
"""Decades below the largest amplitude that are shown, as a line and in colours."""
FEWEST = 4
"""Samples of a record that has a spectrum."""
UNEVEN = 1e-6
"""Largest difference of sampling intervals, over their mean."""
NO_UNIT = "1"


def amplitude_spectrum(record: xr.DataArray, taper: str = "hann") -> xr.DataArray:
    """One-sided amplitude spectrum of a record.

    A harmonic of amplitude A at one of the frequencies has there A. The mean is taken off first.

    **Arguments:**

    - `record`: (N,) over a coordinate "time", s, at equal intervals; such as from `plot.series`.
    - `taper`: the window, as scipy.signal.get_window takes it: "hann", "flattop" (amplitudes that
      are true between frequencies too), "boxcar" (for a whole number of periods).

    **Returns:** (N // 2,) over "frequency", Hz, from that of the whole record on; in the record's
    unit.

    **Raises:** `ValueError` for fewer than four samples, or times at unequal intervals.

    >>> import xarray as xr
    >>> times = np.arange(1000) / 1000.0
    >>> record = xr.DataArray(0.1 * np.cos(2.0 * np.pi * 50.0 * times), {"time": times})
    >>> found = plot.amplitude_spectrum(record)
    >>> float(found.idxmax()), round(float(found.max()), 6)
    (50.0, 0.1)
    """
    times = record["time"].values
    frequency, amplitude = _spectrum(np.asarray(record.values, float), times, taper)
    coordinate = xr.DataArray(frequency, dims="frequency", attrs={"units": "Hz"})
    where, attrs = {"frequency": coordinate}, {"units": record.attrs.get("units", NO_UNIT)}
    return xr.DataArray(amplitude, where, ("frequency",), name=record.name, attrs=attrs)


def _spectrum(values: np.ndarray, times: np.ndarray, taper: str) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies, Hz, and amplitudes, without those of frequency zero."""
    remedy = "save more states"
    require(len(times) >= FEWEST, "record", len(times), f"{FEWEST} samples or more", remedy)
    intervals = np.diff(times)
    shown = f"intervals from {intervals.min():.3g} to {intervals.max():.3g} s"
    remedy = "save states at even times: Saving(np.linspace(0, end, count))"
    require(is_even(intervals), "record", shown, "sampled at equal intervals of time", remedy)
    interval = float(intervals.mean())
    frequency, power = signal.periodogram(
        values, 1.0 / interval, taper, detrend="constant", scaling="spectrum"
    )
    sides = np.full(len(power), 2.0)
    if len(values) % 2 == 0:
        sides[-1] = 1.0
    return frequency[1:], np.sqrt(sides * power)[1:]


def is_even(intervals: np.ndarray) -> bool:
    """Whether times at such intervals, (N - 1,) s, have a spectrum: enough of them, all alike."""
    if len(intervals) + 1 < FEWEST:
        return False
    mean = float(intervals.mean())
    return mean > 0.0 and bool(np.ptp(intervals) <= UNEVEN * mean)


def spectrum(
    scene: Scene,
    solution: Solution,
    quantity: Quantity,
    *,
    unit: str | None = None,
    taper: str = "hann",
    axes: Axes | None = None,
) -> Axes:
    """Amplitude spectrum of any quantity along a solution.

    **Arguments:**

    - `scene`, `solution`, `quantity`, `unit`: as of `plot.series`; the states are saved at equal
      intervals of time, short enough for the impacts: what is faster than half the sampling rate
      folds back.
    - `taper`: the window; see `plot.amplitude_spectrum`.

    **Returns:** the axes; frequency in Hz or kHz, amplitude in the quantity's unit, logarithmic.

    **Raises:** `ValueError` for times at unequal intervals.

    >>> save = cj.Saving(np.linspace(0, 0.5, 101))
    >>> solution = cj.simulate(scene, state, 0.5, save=save, progress=False)
    >>> axes = plot.spectrum(scene, solution, cj.quantities.Velocity("ball", "x"))
    """
    record = series(scene, solution, quantity, unit=unit)
    return spectrum_of(record, taper=taper, axes=axes)


def spectrum_of(record: xr.DataArray, *, taper: str = "hann", axes: Axes | None = None) -> Axes:
    """Amplitude spectrum of a record that is there, such as a measured one or a sweep's lane.

    **Arguments**, **Raises:** as of `plot.amplitude_spectrum`. **Returns:** as of `plot.spectrum`.

    >>> import xarray as xr
    >>> times = np.arange(1000) / 1000.0
    >>> record = xr.DataArray(0.1 * np.cos(2.0 * np.pi * 50.0 * times), {"time": times})
    >>> plot.spectrum_of(record, taper="boxcar").get_title(loc="right")
    'window: boxcar; lines 1 Hz apart'
    """
    found = amplitude_spectrum(record, taper)
    axes = axes_or_new(axes)
    y = scaled(found)
    faster, unit = fitting_unit(found["frequency"].values, "Hz")
    axes.plot(found["frequency"].values * faster, y.values, color=BLUE, linewidth=0.9)
    times = record["time"].values
    half_rate = 0.5 * (len(times) - 1) / float(times[-1] - times[0])
    axes.set_xlim(0.0, float(f"{half_rate * faster:.9g}"))
    largest = y.values.max(initial=0.0)
    if largest > 0.0:
        axes.set_yscale("log")
        axes.set_ylim(max(0.5 * y.values.min(), largest * 10.0**-DECADES), 2.0 * largest)
    lines = f"window: {taper}; lines {float(found['frequency'][0]):.3g} Hz apart"
    axes.set_title(lines, fontsize="small", loc="right")
    return dress(axes, f"frequency, {unit}", f"amplitude of {y.label}")


def waterfall(
    dataset: xr.Dataset,
    saved: str,
    channel: str,
    axis: str | None = None,
    *,
    taper: str = "hann",
    axes: Axes | None = None,
) -> Axes:
    """Amplitude spectra of what a sweep saved, over frequency and swept parameter, in colours.

    Lanes that failed or are pending are grey and hatched.

    **Arguments:**

    - `dataset`: of `sweep` or `open_sweep`, with other axes selected away.
    - `saved`, `channel`: names of the `Saved`, at equal intervals of time in each lane, and of the
      quantity in it.
    - `axis`: the parameter's name; unless given, the sweep's only one.
    - `taper`: the window; see `plot.amplitude_spectrum`.

    **Returns:** the axes; frequency in Hz or kHz to the right, the parameter upwards, logarithmic
    where it spreads over a decade. A bar tells the amplitudes, logarithmic.

    **Raises:** `ValueError` for names that the sweep has not, and unequal intervals.

    >>> stiffness = cj.Axis(lambda scene: scene.forces["spring"].stiffness, [50, 100, 200, 400])
    >>> x = cj.quantities.Position("ball", "x")
    >>> outputs = {"probe": cj.Saved(np.linspace(0.0, 2.0, 201), {"x": (x, "m")})}
    >>> axes = {"stiffness": stiffness}
    >>> found = cj.sweep(scene, state, 2.0, axes, outputs, progress=False)
    >>> drawn = plot.waterfall(found, "probe", "x")
    """
    axis = only_axis(dataset, axis)
    names = f"{saved}_{channel}", f"{saved}_time"
    require_names(dataset, (*names, axis))
    well, dim = ended_well(dataset).values, f"{saved}_number"
    remedy = "sweep to the end first, or resume it"
    require(bool(well.any()), "dataset", "no lane that ran to its end", "one with such", remedy)
    values, times = (dataset[name].transpose(*dataset[axis].dims, dim).values for name in names)
    found = [_spectrum(values[k], times[k], taper) for k in np.flatnonzero(well)]
    frequency, amplitude = np.full((2, len(well), len(found[0][0])), np.nan)
    for k, (frequencies, amplitudes) in zip(np.flatnonzero(well), found, strict=True):
        frequency[k], amplitude[k] = frequencies, amplitudes
    frequency[~well] = found[0][0]
    data = xr.DataArray(amplitude, name=channel, attrs=dataset[names[0]].attrs)
    return _map(frequency, scaled(dataset[axis]), scaled(data), axes_or_new(axes))


def _map(frequency: np.ndarray, up: ScaledValues, colour: ScaledValues, axes: Axes) -> Axes:
    """Colours over frequencies (K, F), Hz, for each of K values of the parameter."""
    faster, unit = fitting_unit(frequency, "Hz")
    order = np.argsort(up.values, kind="stable")
    largest = np.nanmax(colour.values)
    faintest = max(np.nanmin(colour.values), largest * 10.0**-DECADES_OF_COLOUR)
    shades = np.where(np.isnan(colour.values), np.nan, np.maximum(colour.values, faintest))
    places = np.broadcast_to(up.values[:, None], frequency.shape)
    mesh = axes.pcolormesh(
        faster * frequency[order],
        places[order],
        shades[order],
        norm=LogNorm(faintest, largest),
        cmap="cividis",
        shading="nearest",
        rasterized=True,
    )
    scale_axes(axes, np.zeros(1), up.values, swept="y")
    axes.figure.colorbar(mesh, ax=axes, label=f"amplitude of {colour.label}", extend="min")
    axes.patch.set(**MISSING)
    dress(axes, f"frequency, {unit}", up.label)
    axes.grid(False)
    return axes
