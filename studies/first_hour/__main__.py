"""User-defined four-bar with two worn pins: animated, simulated, swept, fitted and reported.

python -m studies.first_hour [FOLDER]
"""

import sys
import time
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

import clearjoint as cj
from clearjoint import plot
from clearjoint.quantities import ContactForce, JournalOffset

BEGAN, FOLDER = time.perf_counter(), Path(sys.argv[1] if sys.argv[1:] else "results/first_hour")
END, AXIS = 0.2, (0, 0, 1)


def worn_pin(
    bearing: str, journal: str, first: float, second: float, clearance: float
) -> cj.ClearanceJoint:
    """Return a worn pin, 20 mm long, with a radial clearance, m, at positions along two rods."""
    pin: dict[str, Any] = {"bearing_radius": 10e-3, "journal_length": 20e-3, "clearance": clearance}
    pin |= {"bearing_point": (first, 0, 0), "journal_point": (second, 0, 0)}
    pin["law"] = cj.laws.LankaraniNikravesh(
        restitution=0.8, stiffness=cj.laws.RavnStiffness(207e9, 0.3)
    )
    return cj.ClearanceJoint(
        bearing, journal, **pin, friction=cj.frictions.RegularisedCoulomb(0.05, 0.01)
    )


def hinge(rod: str, first: float, second: float) -> cj.RevoluteJoint:
    """Return an ideal pin between the ground and a rod."""
    return cj.RevoluteJoint("ground", rod, (first, 0, 0), (second, 0, 0), AXIS, AXIS)


def print_time(result: str) -> None:
    """Print the time of a result."""
    print(f"{time.perf_counter() - BEGAN:6.1f} s  {result}", flush=True)


def main() -> cj.results.Fit:
    """Build, animate, simulate, report, sweep and fit, print the times, and return the fit."""
    cj.configure()
    lengths, masses = {"crank": 0.1, "coupler": 0.3, "rocker": 0.25}, 2.4  # m, kg a metre
    joints = {
        "foot": hinge("crank", 0, -0.05),
        "crank pin": worn_pin("crank", "coupler", 0.05, -0.15, 0.2e-3),
        "rocker pin": worn_pin("coupler", "rocker", 0.15, 0.125, 0.1e-3),
        "rocker foot": hinge("rocker", 0.3, -0.125),
        "motor": cj.PrescribedRotation("ground", "crank", AXIS, speed=20.0, initial_angle=0.9),
    }
    bodies = {name: cj.Body.rod(size, mass=masses * size) for name, size in lengths.items()}
    scene = cj.Scene(bodies, joints, gravity=(0, -9.81, 0))
    poses = {
        "crank": (0.03, 0.04, 0.9),
        "coupler": (0.2, 0.15, 0.5),
        "rocker": (0.33, 0.12, 1.4),
    }
    guess = {n: cj.body_state((x, y, 0), cj.rotation(AXIS, a)) for n, (x, y, a) in poses.items()}
    start = cj.assemble(scene, cj.State(guess))
    FOLDER.mkdir(parents=True, exist_ok=True)
    cj.view(scene, start).save(FOLDER / "scene.html")
    print_time("animated: scene.html")

    save = cj.Saving(np.linspace(0, END, 2001), steps=True, impacts=True)
    solution = cj.simulate(scene, start, END, cj.Settings(ledger=True), save)
    forces = cj.observe(scene, solution).contacts["crank pin"]["V"].normal_force
    print_time(
        f"simulated: {int(solution.accepted)} steps, at most {forces.max():.0f} N in the crank pin"
    )
    cj.view(scene, solution).save(FOLDER / "motion.html")
    plot.report(scene, solution, FOLDER / "report.pdf", title="Four-bar with two worn pins")
    print_time("reported: motion.html, report.pdf")

    clearance = cj.Parameter(lambda s: s.joints["crank pin"].clearance, cj.Log())
    axis = cj.Axis(lambda s: s.joints["crank pin"].clearance, np.geomspace(20e-6, 0.5e-3, 32))
    outputs = {"force": cj.Peak(ContactForce("crank pin"), "N", after=0.05)}
    sweep = cj.sweep(scene, start, END, {"clearance": axis}, outputs, path=FOLDER / "sweep.zarr")
    figure, axes = plt.subplots(layout="constrained")
    plot.against(sweep, "force", axes=axes)
    figure.savefig(FOLDER / "sweep.png")
    print_time(f"swept: {sweep.sizes['clearance']} clearances")

    times = np.linspace(0.25e-3, 0.01, 40)
    offsets = {"x": JournalOffset("crank pin", "x"), "y": JournalOffset("crank pin", "y")}
    found = cj.sensitivities(scene, start, 0.01, {"clearance": clearance}, offsets, times)
    series = {k: cj.Series(offsets[k], times, found.outputs[k], noise=5e-6) for k in offsets}
    measured = cj.Measurements(series).with_noise(np.random.default_rng(0))
    options = {"guess": {"clearance": 0.1e-3}, "grow": (0.002, 0.004, 0.006, 0.008)}
    fit = cj.identify(scene, start, measured, {"clearance": clearance}, **options)
    print_time(f"fitted: {fit.estimates['clearance'] * 1e6:.1f} µm, {fit.ending.value}")
    return fit


if __name__ == "__main__":
    main()
