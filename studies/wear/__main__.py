"""Wear of a slider-crank's pin over a million cycles.

    python -m studies.wear [profile|life] [--quick] [--renew] [--output FOLDER]

`profile` computes the worn wall with three lengths of stages, whose differences show the error of
the extrapolation. `life` compares derivatives of the number of cycles to a depth with differences.
"""

import argparse
from collections.abc import Callable

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint import plot
from clearjoint.plot import style
from studies.common.output import Output, add_options

PIN = "slider pin"
CLEARANCE, RESTITUTION, SPEED = 50e-6, 0.1, 300.0
"""Radial clearance, m, restitution, and speed of the crank, rad/s."""
CYCLE = 2.0 * np.pi / SPEED
RATES = {PIN: cj.WearRates(bearing=3e-16)}
"""About that of steel on steel with poor lubrication."""
CYCLES, DEPTH = 1e6, 2e-6
"""Number of cycles of the profile, and depth, m, at which the pin's life ends."""
CHANGES = (4e-7, 2e-7, 1e-7)
"""Largest changes of the depth in a stage, m."""
DIFFERENCE = 0.01
"""Change of a parameter's logarithm for differences."""
PARAMETERS = {
    "clearance": cj.Parameter(lambda scene: scene.joints[PIN].clearance, cj.Log()),
    "mass of the slider": cj.Parameter(lambda scene: scene.bodies["slider"].mass, cj.Log()),
}


def worn(scene: cj.Scene, cycles: float | np.ndarray, quick: bool, **options) -> xr.Dataset:
    """Return the wear of the pin's bearing; `options` of `cj.wear`."""
    _, state = cj.mechanisms.slider_crank(CLEARANCE, RESTITUTION, speed=SPEED)
    size = {"samples": 16, "stages": 3, "settle": 6} if quick else {"samples": 48, "settle": 6}
    given = scene, state, CYCLE, RATES, cycles
    return cj.wear(*given, tolerance=0.2, progress=False, **size, **options)


def crank() -> cj.Scene:
    """Return the slider-crank."""
    return cj.mechanisms.slider_crank(CLEARANCE, RESTITUTION, speed=SPEED)[0]


def profile(output: Output) -> list[str]:
    """Draw the worn wall, and compare it with that of other lengths of stages."""
    found = [worn(crank(), CYCLES, output.quick, largest_change=change) for change in CHANGES]
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
        for change, one, depth in zip(CHANGES, found, at_end, strict=True)
    ]
    figure = Figure(figsize=(10.0, 4.5), layout="constrained")
    left = figure.add_subplot(1, 2, 1, projection="polar")
    plot.worn_profile(found[-1], PIN, axes=left)
    right = figure.add_subplot(1, 2, 2)
    for change, one, depth in zip(CHANGES, found, depths, strict=True):
        label = f"{change * 1e6:.1f} µm in a stage"
        right.plot(one["cycles"], 1e6 * depth.max("angle"), ".-", label=label)
    style.dress(right, "cycles", "largest depth, µm")
    right.legend()
    output.save(figure, "profile")
    return [f"after {end:.3g} cycles:", *lines]


def _at(cycles: np.ndarray, depths: np.ndarray, number: float) -> np.ndarray:
    return np.array([np.interp(number, cycles, row) for row in depths.T])


def life(output: Output) -> list[str]:
    """Compare derivatives of the life by the mean depth with central differences."""
    quick = output.quick
    given = {"parameters": PARAMETERS, "settings": cj.presets.derivatives}
    found = worn(crank(), CYCLES, quick, largest_change=CHANGES[0], **given)
    mean = found.mean("angle", keepdims=True)
    depth = min(DEPTH, 0.9 * float(mean["bearing_depth"][0, -1].max()))
    derivatives = cj.life_derivatives(mean, depth, PIN)
    lines = [f"life to a mean depth of {depth * 1e6:.2f} µm: {_life(mean, depth):.4g} cycles"]
    for name, parameter in PARAMETERS.items():
        lives = []
        for sign in (1.0, -1.0):
            path = parameter.variation.function
            value = float(path(crank())) * np.exp(sign * DIFFERENCE)
            other = cj.set_value(crank(), path, value)
            cycles = found["cycles"].values[1:]
            run = worn(other, cycles, quick, settings=cj.presets.derivatives)
            lives.append(_life(run.mean("angle", keepdims=True), depth))
        difference = (lives[0] - lives[1]) / (2.0 * DIFFERENCE)
        lines.append(f"by the logarithm of {name}: {derivatives[name]:.4g}, {difference:.4g}")
    name = f"{PIN} bearing rate"
    return [*lines, f"by the logarithm of the wear rate: {derivatives[name]:.4g}"]


def _life(found: xr.Dataset, depth: float) -> float:
    return cj.cycles_to_depth(found, depth, PIN)


PARTS: dict[str, Callable[[Output], list[str]]] = {"profile": profile, "life": life}


def main(arguments: list[str] | None = None) -> list[str]:
    """Run the study, print its findings, and return them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("part", nargs="?", choices=list(PARTS), help="by default both")
    add_options(parser, "few stages")
    options = parser.parse_args(arguments)
    cj.configure()
    output = Output.of(__file__, options)
    names = list(PARTS) if options.part is None else [options.part]
    lines = [line for name in names for line in PARTS[name](output)]
    print("\n".join(f"- {line}" for line in lines), flush=True)
    return lines


if __name__ == "__main__":
    main()
