"""Wear of a slider-crank's pin over a million cycles.

    python -m studies.wear [profile|groove|life|steps] [--quick] [--renew] [--output FOLDER]

`profile` computes the worn wall with three errors of stages, whose differences show the error of
the result. `groove` compares the wear of a constant load with a closed form, to a hundred times the
elastic penetration. `life` compares derivatives of the number of cycles to a depth with
differences.
`steps` compares derivatives of worn depths by the clearance with differences over three steps.
"""

from collections.abc import Callable
from dataclasses import replace
from time import process_time
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from scipy.optimize import root_scalar

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
ERRORS = (0.1, 0.01, 0.001)
"""Largest corrections of a stage, relative to the depth and the penetration."""
FIXED = {"largest_change": 2e-6, "stage_error": 1e-4}
"""Options for depths of which differences are taken."""
RADIUS, LENGTH, STEADY_LOAD, STEADY_SPEED = 10e-3, 20e-3, 1000.0, 200.0
"""Radius and length of a bearing, m, its load, N, and the speed of its journal, rad/s."""
STEADY_RATE, STEADY_CYCLES = 3e-14, 1e5
"""Specific wear rate of that bearing, m^2/N, and number of revolutions."""
DIFFERENCE = 0.01
"""Relative change of a parameter for differences."""
STEPS = (1e-2, 1e-3, 1e-4)
"""Relative changes of the clearance."""
TIGHT = cj.Settings(rtol=1e-10, landing_tolerance=1e-13, derivative_tolerance=10.0)
AFTER = np.array([1e5, 3e5])
"""Numbers of cycles after which depths are compared."""
PATHS = {
    "clearance": lambda scene: scene.joints[PIN].clearance,
    "slider's mass": lambda scene: scene.bodies["slider"].mass,
    "load": lambda scene: scene.forces["press"].force[0],
}
PARAMETERS = {name: cj.Parameter(path) for name, path in PATHS.items()}


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
    errors = ERRORS[:2] if output.quick else ERRORS
    found = [worn(press()[0], CYCLES, output.quick, stage_error=error) for error in errors]
    end = min(float(one["cycles"][-1]) for one in found)
    depths = [one["bearing_depth"].sel(joint=PIN) for one in found]
    at_end = [
        _at(one["cycles"].values, depth.values, end)
        for one, depth in zip(found, depths, strict=True)
    ]
    finest = at_end[-1]
    lines = [
        f"error of stages {error:g}: {len(one['stage'])} stages, deepest "
        f"{depth.max() * 1e6:.3f} µm, largest difference {abs(depth - finest).max() * 1e6:.3f} µm, "
        f"difference of the mean {(depth.mean() / finest.mean() - 1.0) * 100:+.2f} %"
        for error, one, depth in zip(errors, found, at_end, strict=True)
    ]
    figure = Figure(figsize=(10.0, 4.5), layout="constrained")
    left = figure.add_subplot(1, 2, 1, projection="polar")
    plot.worn_profile(found[-1], PIN, axes=left)
    right = figure.add_subplot(1, 2, 2)
    for error, one, depth in zip(errors, found, depths, strict=True):
        label = f"error of stages {error:g}"
        right.plot(one["cycles"], 1e6 * depth.max("angle"), ".-", label=label)
    style.dress(right, "cycles", "largest depth, µm")
    right.legend()
    output.save(figure, "profile")
    return [f"after {end:.3g} cycles:", *lines]


def _at(cycles: np.ndarray, depths: np.ndarray, number: float) -> np.ndarray:
    return np.array([np.interp(number, cycles, row) for row in depths.T])


def bearing() -> tuple[cj.Scene, cj.State]:
    """Return a journal that rotates in a bearing under a constant load, and its state."""
    here, axis = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    pin = cj.ClearanceJoint(
        "ground",
        "journal",
        bearing_radius=RADIUS,
        clearance=2.0 * CLEARANCE,
        journal_length=LENGTH,
        law=LAW,
    )
    joints = {
        "pin": pin,
        "plane": cj.PlanarJoint("ground", "journal", here, here, axis, axis),
        "motor": cj.PrescribedRotation("ground", "journal", axis, STEADY_SPEED),
    }
    load = cj.AppliedLoad("journal", force=(STEADY_LOAD, 0.0, 0.0))
    scene = cj.Scene({"journal": cj.Body(0.5, (1e-4, 1e-4, 1e-4))}, joints, {"load": load})
    start = 2.0 * CLEARANCE + 0.5 * STEADY_LOAD / float(LAW.stiffness.stiffness)
    return scene, cj.State({"journal": cj.body_state((start, 0, 0), spin=(0, 0, STEADY_SPEED))})


def rigid_groove(area: float) -> float:
    """Return the depth, m, of the groove that a rigid journal wears into the bearing, by the area
    of its cross-section over the radius, m."""

    def excess(depth: float) -> float:
        eccentricity = 2.0 * CLEARANCE + depth
        half = np.arccos(2.0 * CLEARANCE / eccentricity)
        return 2.0 * (eccentricity * np.sin(half) - 2.0 * CLEARANCE * half) - area

    return root_scalar(excess, bracket=(1e-12, 0.1)).root


def groove(output: Output) -> list[str]:
    """Compare the groove of a constant load with that of a rigid journal."""
    (scene, state), rates = bearing(), {"pin": cj.WearRates(bearing=STEADY_RATE)}
    cycles = STEADY_CYCLES / (50.0 if output.quick else 1.0)
    options = {"samples": 48 if output.quick else 96, "progress": False}
    begun = process_time()
    found = cj.wear(scene, state, 2.0 * np.pi / STEADY_SPEED, rates, cycles, **options)
    spent = process_time() - begun
    lines = [f"{cycles:g} revolutions: {len(found['stage'])} stages, {spent:.0f} s of processor"]
    penetration = float(found["penetration"].max())
    for stage in range(1, len(found["stage"])):
        depths = found["bearing_depth"][0, stage].values
        exact = rigid_groove(2.0 * np.pi * float(depths.mean()))
        lines.append(
            f"{float(found['cycles'][stage]):.0f} revolutions: {depths.max() / penetration:.2f} "
            f"penetrations, {depths.max() * 1e6:.3f} µm, a rigid journal {exact * 1e6:.3f} µm"
        )
    # The surface of the journal slides past the bearing, which stands still.
    distance = 2.0 * np.pi * cycles * (RADIUS - 2.0 * CLEARANCE - 0.5 * penetration)
    volume = STEADY_RATE * STEADY_LOAD * distance
    error = float(found["bearing_volume"][0, -1]) / volume - 1.0
    return [*lines, f"volume: {volume * 1e9:.4f} mm^3 by Archard's law, relative error {error:.1e}"]


def life(output: Output) -> list[str]:
    """Compare derivatives of the life to a mean depth with central differences; each is multiplied
    by the value of the parameter."""
    quick, scene = output.quick, press()[0]
    given = {"parameters": PARAMETERS, "settings": cj.presets.derivatives, **FIXED}
    found = worn(scene, CYCLES, quick, **given)
    mean = found.mean("angle", keepdims=True)
    depth = SHARE * float(mean["bearing_depth"].max())
    derivatives = cj.life_derivatives(mean, depth, PIN)
    end = cj.cycles_to_depth(mean, depth, PIN)
    lines = [f"life to a mean depth of {depth * 1e6:.2f} µm: {end:.4g} cycles"]
    for name, path in PATHS.items():
        lives, value = [], float(path(scene))
        for sign in (1.0, -1.0):
            other = cj.set_value(scene, path, value * (1.0 + sign * DIFFERENCE))
            cycles = found["cycles"].values[1:]
            run = worn(other, cycles, quick, settings=cj.presets.derivatives, **FIXED)
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
    path, lines = PATHS["clearance"], []
    for name, settings in {"derivatives": cj.presets.derivatives, "tight": TIGHT}.items():
        options = {"settings": settings, "stages": 4, **FIXED}
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


PARTS: dict[str, Callable[[Output], list[str]]] = {
    "profile": profile,
    "groove": groove,
    "life": life,
    "steps": steps,
}


def main(arguments: list[str] | None = None) -> list[str]:
    """Run the study, print its findings, and return them."""
    return run_parts(__file__, __doc__, PARTS, "few stages", arguments)


if __name__ == "__main__":
    main()
