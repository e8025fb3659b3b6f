"""Spectra of quantities."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from scipy import signal

from ..fields.checks import require
from ..model.scene import Scene
from ..quantities.base import Quantity
from ..simulation.results.solution import Solution
from .along import series
from .labels import fitting_unit, scaled
from .style import BLUE, axes_or_new, dress

DECADES = 8.0
"""Decades below the largest amplitude that are shown."""
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
