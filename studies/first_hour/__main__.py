"""A four-bar of one's own, with two worn pins: seen, run, swept, fitted and reported by one file.

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


def worn(bearing: str, journal: str, at: float, there: float, play: float) -> cj.ClearanceJoint:
    """A pin of 20 mm with so much radial play, m, at places along two rods."""
    pin: dict[str, Any] = {"bearing_radius": 10e-3, "journal_length": 20e-3, "clearance": play}
    pin |= {"bearing_point": (at, 0, 0), "journal_point": (there, 0, 0)}
    pin["law"] = cj.laws.LankaraniNikravesh(
        restitution=0.8, stiffness=cj.laws.RavnStiffness(207e9, 0.3)
    )
    return cj.ClearanceJoint(
        bearing, journal, **pin, friction=cj.frictions.RegularisedCoulomb(0.05, 0.01)
    )


def hinge(rod: str, at: float, there: float) -> cj.RevoluteJoint:
    """An ideal pin between the ground and a rod."""
    return cj.RevoluteJoint("ground", rod, (at, 0, 0), (there, 0, 0), AXIS, AXIS)


def said(what: str) -> None:
    """Tell when there is an answer."""
    print(f"{time.perf_counter() - BEGAN:6.1f} s  {what}", flush=True)


def main() -> None:
    """Build, see, run, sweep, fit and report, and tell how long each took."""
    cj.configure()
    lengths, masses = {"crank": 0.1, "coupler": 0.3, "rocker": 0.25}, 2.4  # m, kg a metre
    joints = {
        "foot": hinge("crank", 0, -0.05),
        "crank pin": worn("crank", "coupler", 0.05, -0.15, 0.2e-3),
        "rocker pin": worn("coupler", "rocker", 0.15, 0.125, 0.1e-3),
        "rocker foot": hinge("rocker", 0.3, -0.125),
        "motor": cj.PrescribedRotation("ground", "crank", AXIS, speed=20.0, initial_angle=0.9),
    }
    bodies = {name: cj.Body.rod(size, mass=masses * size) for name, size in lengths.items()}
    scene = cj.Scene(bodies, joints, gravity=(0, -9.81, 0))
    places = {"crank": (0.03, 0.04, 0.9), "coupler": (0.2, 0.15, 0.5), "rocker": (0.33, 0.12, 1.4)}
    guess = {n: cj.body_state((x, y, 0), cj.rotation(AXIS, a)) for n, (x, y, a) in places.items()}
    start = cj.assemble(scene, cj.State(guess))
    FOLDER.mkdir(parents=True, exist_ok=True)
    cj.view(scene, start).save(FOLDER / "scene.html")
    said("seen: scene.html")

    save = cj.Saving(np.linspace(0, END, 2001), steps=True, impacts=True)
    solution = cj.simulate(scene, start, END, cj.Settings(ledger=True), save)
    forces = cj.observe(scene, solution).contacts["crank pin"]["V"].normal_force
    said(f"run: {int(solution.accepted)} steps, at most {forces.max():.0f} N in the crank pin")
    cj.view(scene, solution).save(FOLDER / "motion.html")
    plot.report(scene, solution, FOLDER / "report.pdf", title="Four-bar with two worn pins")
    said("reported: motion.html, report.pdf")

    play = cj.Parameter(lambda s: s.joints["crank pin"].clearance, cj.Log())
    axis = cj.Axis(lambda s: s.joints["crank pin"].clearance, np.geomspace(20e-6, 0.5e-3, 32))
    outputs = {"force": cj.Peak(ContactForce("crank pin"), "N", after=0.05)}
    sweep = cj.sweep(scene, start, END, {"clearance": axis}, outputs, path=FOLDER / "sweep.zarr")
    figure, axes = plt.subplots(layout="constrained")
    plot.against(sweep, "force", axes=axes)
    figure.savefig(FOLDER / "sweep.png")
    said(f"swept: {sweep.sizes['clearance']} clearances")

    times = np.linspace(0.25e-3, 0.01, 40)
    offsets = {"x": JournalOffset("crank pin", "x"), "y": JournalOffset("crank pin", "y")}
    seen = cj.sensitivities(scene, start, 0.01, {"clearance": play}, offsets, times)
    series = {k: cj.Series(offsets[k], times, seen.values[k], noise=5e-6) for k in offsets}
    measured = cj.Measurements(series).with_noise(np.random.default_rng(0))
    how = {"guess": {"clearance": 0.1e-3}, "grow": (0.002, 0.004, 0.006, 0.008)}
    fit = cj.identify(scene, start, measured, {"clearance": play}, **how)
    said(f"fitted: {fit.estimates['clearance'] * 1e6:.1f} µm, {fit.ending.value}")


if __name__ == "__main__":
    main()
