"""Errors and times of runs and derivatives in both programs."""

import re
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import clearjoint as cj
from studies.backlash import ours, recipe
from studies.backlash.shafts import END, exact, exact_derivative
from studies.benchmark.backlash_chain import chain

STEPS = (5e-4, 1e-4, 1e-5, 1e-6)
TOLERANCES = (1e-4, 1e-6, 1e-8)
QUICK = slice(0, 1)
INTEGRATORS = ("implicitfast", "RK4")
CHANGES = (1e-2, 1e-4)
"""Relative changes of the backlash for differences."""
CLEARJOINT = "clearjoint"


@dataclass(frozen=True)
class Trial:
    """A run or a derivative: program, setting, `errors`, and time taken, s."""

    who: str
    setting: str
    errors: tuple[float, ...]
    seconds: float


def motions(quick: bool) -> list[Trial]:
    """Return errors of the final angles, rad, and relative errors of the energy."""
    truth = exact(np.array([END]))[0]
    few = QUICK if quick else slice(None)
    found = [(CLEARJOINT, f"rtol {rtol:g}", ours.run(rtol)) for rtol in TOLERANCES[few]]
    for name in INTEGRATORS:
        for step in STEPS[few]:
            found.append((f"MuJoCo, {name}", f"step {step:g} s", recipe.run(step, name)))
    return [
        Trial(
            who,
            setting,
            (float(abs(run.angles - truth.angles).max()), abs(run.energy / truth.energy - 1.0)),
            seconds,
        )
        for who, setting, (run, seconds) in found
    ]


def derivatives(quick: bool) -> list[Trial]:
    """Return relative errors of the derivative of the link's angle by the backlash."""
    truth = exact_derivative(END)
    few = QUICK if quick else slice(None)
    found = [(CLEARJOINT, f"rtol {rtol:g}", ours.derivative(rtol)) for rtol in TOLERANCES[few]]
    for change in CHANGES:
        for step in STEPS[few]:
            who = f"MuJoCo, RK4, play ±{100.0 * change:g} %"
            found.append((who, f"step {step:g} s", recipe.derivative(step, "RK4", change)))
    return [
        Trial(who, setting, (abs(slope / truth - 1.0),), seconds)
        for who, setting, (slope, seconds) in found
    ]


JOINTS, SPAN, GRAVITY = 3, 0.1, (0.0, -9.81, 0.0)
"""Joints of the chain with gravity, and its simulated time, s."""
LIMITS = {
    "as `save_mjcf` writes it": ("", ""),
    "impedance 0.9999": (r'solimplimit="0.0001 0.0001', 'solimplimit="0.9999 0.9999'),
    "MuJoCo's default": (r' sol(ref|imp)limit="[^"]*"', ""),
}
"""What is replaced in the file, for each kind of limit."""


def limits(quick: bool) -> list[list[str]]:
    """Return a table of the largest difference of an angle in MuJoCo from that in clearjoint, rad,
    in a chain of links with backlash that falls, for each limit and step of MuJoCo."""
    steps = (1e-4,) if quick else (1e-4, 1e-5, 1e-6)
    scene, state = chain(JOINTS)
    scene = cj.Scene(scene.bodies, scene.joints, gravity=GRAVITY)
    table = [["limit", *(f"step {1e6 * step:g} µs" for step in steps)]]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "chain.xml")
        for name, replacement in LIMITS.items():
            cj.save_mjcf(scene, path, state)
            path.write_text(re.sub(*replacement, path.read_text()))
            found = cj.compare_with_mujoco(scene, state, SPAN, path=path, timesteps=steps)
            largest = np.max([*found.largest_difference.values()], axis=0)
            table.append([name, *(f"{difference:.1e}" for difference in largest)])
    return table


def rows(trials: Sequence[Trial], *errors: str) -> list[list[str]]:
    """Return the table of errors by name and times in ms as text."""
    head = ["", "", *errors, "time, ms"]
    return [head, *([t.who, t.setting, *map("{:.1e}".format, t.errors), _ms(t)] for t in trials)]


def _ms(trial: Trial) -> str:
    return f"{1e3 * trial.seconds:.2g}"
