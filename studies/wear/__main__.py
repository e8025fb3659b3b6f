"""Wear of a slider-crank's pin over a million cycles.

    python -m studies.wear [profile|life|steps] [--quick] [--renew] [--output FOLDER]

`profile` computes the worn wall with three lengths of stages, whose differences show the error of
the extrapolation. `life` compares derivatives of the number of cycles to a depth with differences.
`steps` compares derivatives of worn depths by the clearance with differences over three steps.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint import plot
from clearjoint.plot import style
from studies.common.output import Output, run_parts

PIN = "slider pin"
CLEARANCE, LOAD, SPEED = 50e-6, 1500.0, 300.0
"""Radial clearance, m, force that presses the slider towards the crank, N, and speed of the crank,
rad/s."""
CYCLE = 2.0 * np.pi / SPEED
LAW = cj.laws.ElastoGap(stiffness=1e8, damping=1e4, exponent=1.0)
RATES = {PIN: cj.WearRates(bearing=1e-16)}
CYCLES = 1e6
SHARE = 0.9
"""Mean depth at which the pin's life ends, relative to that after all cycles."""
CHANGES = (2e-6, 1e-6, 5e-7)
"""Largest changes of the depth in a stage, m."""
DIFFERENCE = 0.01
"""Relative change of a parameter for differences."""
STEPS = (1e-2, 1e-3, 1e-4)
"""Relative changes of the clearance."""
TIGHT = cj.Settings(rtol=1e-10, landing_tolerance=1e-13, derivative_tolerance=10.0)
AFTER = np.array([1e5, 3e5])
"""Numbers of cycles after which depths are compared."""
PARAMETERS = {
    "clearance": cj.Parameter(lambda scene: scene.joints[PIN].clearance),
    "slider's mass": cj.Parameter(lambda scene: scene.bodies["slider"].mass),
    "load": cj.Parameter(lambda scene: scene.forces["press"].force[0]),
}


def press() -> tuple[cj.Scene, cj.State]:
    """Return a slider-crank with a load that keeps the pin's contact closed, and its state."""
    scene, state = cj.mechanisms.slider_crank(CLEARANCE, law=LAW, speed=SPEED)
    load = cj.AppliedLoad("slider", force=(-LOAD, 0.0, 0.0))
    return replace(scene, forces={**scene.forces, "press": load}), state


def worn(scene: cj.Scene, cycles: float | np.ndarray, quick: bool, **options) -> xr.Dataset:
    """Return the wear of the pin's bearing; `options` of `cj.wear`."""
    size: dict[str, Any] = {"samples": 16, "stages": 2} if quick else {"samples": 48}
    given = scene, press()[1], CYCLE, RATES, cycles
    return cj.wear(*given, settle=1 if quick else 3, progress=False, **size | options)


def profile(output: Output) -> list[str]:
    """Draw the worn wall, and compare it with that of other lengths of stages."""
    changes = CHANGES[:2] if output.quick else CHANGES
    found = [worn(press()[0], CYCLES, output.quick, largest_change=change) for change in changes]
    end = min(float(one["cycles"][-1]) for one in found)
    depths = [one["bearing_depth"].sel(joint=PIN) for one in found]
    at_end = [
        _at(one["cycles"].values, depth.values, end)
        for one, depth in zip(found, depths, strict=True)
    ]
    finest = at_end[-1]
    lines = [
        f"stages of {change * 1e6:.1f} µm: {len(one['stage']) - 1} runs, deepest "
        f"{depth.max() * 1e6:.3f} µm, largest difference {abs(depth - finest).max() * 1e6:.3f} µm, "
        f"difference of the mean {(depth.mean() / finest.mean() - 1.0) * 100:+.2f} %"
        for change, one, depth in zip(changes, found, at_end, strict=True)
    ]
    figure = Figure(figsize=(10.0, 4.5), layout="constrained")
    left = figure.add_subplot(1, 2, 1, projection="polar")
    plot.worn_profile(found[-1], PIN, axes=left)
    right = figure.add_subplot(1, 2, 2)
    for change, one, depth in zip(changes, found, depths, strict=True):
        label = f"{change * 1e6:.1f} µm in a stage"
        right.plot(one["cycles"], 1e6 * depth.max("angle"), ".-", label=label)
    style.dress(right, "cycles", "largest depth, µm")
    right.legend()
    output.save(figure, "profile")
    return [f"after {end:.3g} cycles:", *lines]


def _at(cycles: np.ndarray, depths: np.ndarray, number: float) -> np.ndarray:
    return np.array([np.interp(number, cycles, row) for row in depths.T])


def life(output: Output) -> list[str]:
    """Compare derivatives of the life to a mean depth with central differences; each is multiplied
    by the value of the parameter."""
    quick, scene = output.quick, press()[0]
    given = {"parameters": PARAMETERS, "settings": cj.presets.derivatives}
    found = worn(scene, CYCLES, quick, largest_change=CHANGES[0], **given)
    mean = found.mean("angle", keepdims=True)
    depth = SHARE * float(mean["bearing_depth"].max())
    derivatives = cj.life_derivatives(mean, depth, PIN)
    end = cj.cycles_to_depth(mean, depth, PIN)
    lines = [f"life to a mean depth of {depth * 1e6:.2f} µm: {end:.4g} cycles"]
    for name, parameter in PARAMETERS.items():
        path, lives = parameter.variation.function, []
        value = float(path(scene))
        for sign in (1.0, -1.0):
            other = cj.set_value(scene, path, value * (1.0 + sign * DIFFERENCE))
            cycles = found["cycles"].values[1:]
            run = worn(other, cycles, quick, settings=cj.presets.derivatives)
            lives.append(cj.cycles_to_depth(run.mean("angle", keepdims=True), depth, PIN))
        difference = (lives[0] - lives[1]) / (2.0 * DIFFERENCE)
        derivative = value * derivatives[name]
        lines.append(f"{name}: {derivative:.5g} cycles, by differences {difference:.5g}")
    name = f"{PIN} bearing rate"
    return [*lines, f"wear rate: {derivatives[name]:.5g} cycles"]


def steps(output: Output) -> list[str]:
    """Compare the derivative of the mean depth by the clearance with central differences, for two
    settings; all are multiplied by the clearance and divided by the depth."""
    scene, clearance = press()[0], {"clearance": PARAMETERS["clearance"]}
    path, lines = clearance["clearance"].variation.function, []
    for name, settings in {"derivatives": cj.presets.derivatives, "tight": TIGHT}.items():
        options = {"settings": settings, "stages": 3}
        found = _means(worn(scene, AFTER, True, parameters=clearance, **options))
        depth = found["bearing_depth"]
        slope = found["bearing_depth_derivative"].sel(parameter="clearance")
        lines.append(f"{name}, derivative: {_row(CLEARANCE * slope / depth)}")
        for step in STEPS:
            higher, lower = (
                _means(worn(cj.set_value(scene, path, CLEARANCE * size), AFTER, True, **options))
                for size in (1.0 + step, 1.0 - step)
            )
            difference = (higher - lower)["bearing_depth"] / (2.0 * step)
            lines.append(f"{name}, differences over {step:g}: {_row(difference / depth)}")
        if output.quick:
            break
    return lines


def _means(found: xr.Dataset) -> xr.Dataset:
    """Return the depths of the pin's bearing after each stage, averaged over the angles."""
    return found.sel(joint=PIN).mean("angle").isel(stage=slice(1, None))


def _row(values: xr.DataArray) -> str:
    return ", ".join(f"{value:.3e}" for value in values.values.ravel())


PARTS: dict[str, Callable[[Output], list[str]]] = {"profile": profile, "life": life, "steps": steps}


def main(arguments: list[str] | None = None) -> list[str]:
    """Run the study, print its findings, and return them."""
    return run_parts(__file__, __doc__, PARTS, "few stages", arguments)


if __name__ == "__main__":
    main()
