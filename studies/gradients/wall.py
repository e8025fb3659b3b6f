"""The wall of a worn bearing from the orbit of its journal: a fit of 64 numbers."""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import PyTree
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint.extend import ZERO, Instant, Motions, Scalar, Wrench
from clearjoint.plot import style
from studies.gradients.searches import Problem, Search

CLEARANCE, LOAD, DAMPING, NOISE = 0.25e-3, 400.0, 1500.0, 0.1e-6
SPAN, KNOTS, SAMPLES, ITERATIONS = 0.25, 64, 400, 30
QUICK = 0.05, 16, 80, 6
FIRST, TURN = -0.5 * np.pi, 1.5 * np.pi
"""Direction of the load at the start, and by how much it turns, rad."""
SMOOTHING = 1e-2
"""Weight of the squares of the second differences of the spline's coefficients."""
SCALE = 1e-2
"""Factor of the objective with which the first step of the search is some micrometres long."""
SMOOTH_WAVES = 4.0
"""Number of waves around the circumference above which the search takes shorter steps."""
MICROMETRE = 1e-6


def worn(angles: np.ndarray) -> np.ndarray:
    """Return the depth of wear, m: a deep pocket where the load begins, and a shallow one that the
    journal reaches only in part."""

    def pocket(at: float, width: float) -> np.ndarray:
        away = (angles - at + np.pi) % (2.0 * np.pi) - np.pi
        return np.exp(-0.5 * (away / width) ** 2)

    return 30e-6 * pocket(FIRST + 0.6, 0.5) + 15e-6 * pocket(2.9, 0.45)


class Drag(cj.extend.AbstractForce):
    """Resistance of the lubricant to the motion of the rotor, `damping` in N s/m."""

    damping: float

    def body_names(self) -> tuple[str, ...]:
        """Return the name of the rotor."""
        return ("rotor",)

    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        """Return the force on the rotor."""
        del t
        return {"rotor": Wrench(motions["rotor"].velocity * -self.damping, ZERO)}


def bearing(wall: np.ndarray, span: float) -> tuple[cj.Scene, cj.State]:
    """Return a rotor in a plastic bush with deviations from a circle (N,), m, under a load that
    turns: the journal falls onto the wall, bounces and then moves along it."""
    law = cj.laws.LankaraniNikravesh(restitution=0.5, stiffness=cj.laws.RavnStiffness(3e9, 0.4))
    scene, state = cj.mechanisms.rotor_in_bearing(
        CLEARANCE, law=law, gravity=None, speed=50.0, offset=(0.0, -0.5)
    )
    profile = cj.profiles.PeriodicSpline.through(wall)
    joint = replace(scene.joints["bearing"], bearing_profile=profile)
    rate = TURN / span
    load = cj.AppliedLoad(
        "rotor",
        (
            lambda t: LOAD * jnp.cos(FIRST + rate * t),
            lambda t: LOAD * jnp.sin(FIRST + rate * t),
            0.0,
        ),
    )
    joints = {**scene.joints, "bearing": joint}
    return replace(scene, joints=joints, forces={"load": load, "drag": Drag(DAMPING)}), state


def roughness(now: Instant) -> jax.Array:
    """Return the sum of the squares of the second differences of the wall's coefficients, m^2."""
    row = now.scene.joints["bearing"].bearing_profile.coefficients
    return jnp.sum((jnp.roll(row, 1) - 2.0 * row + jnp.roll(row, -1)) ** 2)


PROBES = {axis: cj.quantities.JournalOffset("bearing", axis) for axis in ("x", "y")}


def smooth_steps(knots: int) -> optax.GradientTransformation:
    """Return L-BFGS for a wall of which k waves are divided by 1 + (k/4)^2, a guess of their
    size: short waves move the journal most, and would else determine all steps."""
    waves = np.minimum(np.arange(knots), knots - np.arange(knots))
    sizes = 1.0 / (1.0 + (waves / SMOOTH_WAVES) ** 2)
    halving = optax.scale_by_backtracking_linesearch(
        12, decrease_factor=0.5, increase_factor=2.0**12
    )
    search = optax.lbfgs(linesearch=halving)

    def scaled(wall: PyTree, factors: np.ndarray) -> PyTree:
        return jax.tree.map(lambda row: jnp.fft.ifft(factors * jnp.fft.fft(row)).real, wall)

    # By the names of optax's protocol.
    def update(updates, state, params=None, **extra):  # noqa: ANN001, ANN003, ANN202
        along = scaled(updates, sizes)
        further = {
            "value": extra["value"],
            "grad": along,
            "value_fn": lambda at: extra["value_fn"](scaled(at, sizes)),
        }
        step, state = search.update(along, state, scaled(params, 1.0 / sizes), **further)
        return scaled(step, sizes), state

    return optax.GradientTransformationExtraArgs(search.init, update)


@dataclass(frozen=True)
class Wall:
    """A fitted wall.

    - `angles` (N,): of the knots, rad; `true`, `fitted` (N,): the wall there, m.
    - `touched` (N,): whether the recorded journal touched the wall within half a spacing.
    - `x`, `y` (samples,): the record, m.
    - `search`: for the smallest objective, m^2.
    """

    angles: np.ndarray
    true: np.ndarray
    fitted: np.ndarray
    touched: np.ndarray
    x: np.ndarray
    y: np.ndarray
    search: Search

    def error(self, chosen: np.ndarray) -> tuple[float, float]:
        """Return root mean square and largest error of the wall at chosen knots, m."""
        errors = (self.fitted - self.true)[chosen]
        return float(np.sqrt(np.mean(errors**2))), float(np.abs(errors).max())


def measure(quick: bool) -> Wall:
    """Record the orbit in a worn bearing, and fit its wall from a circle."""
    span, knots, samples, iterations = QUICK if quick else (SPAN, KNOTS, SAMPLES, ITERATIONS)
    angles = 2.0 * np.pi * np.arange(knots) / knots
    true, times = worn(angles), np.linspace(0.0, span, samples + 1)[1:]
    random = np.random.default_rng(0)
    observed = cj.simulate(
        *bearing(true, span), span, cj.presets.derivatives, cj.Saving(times), outputs=PROBES,
        progress=False,
    )  # fmt: skip
    clean = {axis: np.asarray(observed.outputs[axis]) for axis in PROBES}
    record = {axis: row + NOISE * random.standard_normal(samples) for axis, row in clean.items()}

    def objective(outputs: dict[str, jax.Array]) -> jax.Array:
        misfit = sum(jnp.sum((outputs[axis] - record[axis]) ** 2) for axis in PROBES)
        return SCALE * (misfit * knots / samples + SMOOTHING * outputs["roughness"][-1])

    problem = Problem(
        *bearing(np.zeros(knots), span),
        path=lambda scene: scene.joints["bearing"].bearing_profile.coefficients,
        outputs={**PROBES, "roughness": roughness},
        times=times,
        objective=objective,
        step=1e-8,
        optimiser=smooth_steps(knots),
    )
    touched = _touched(clean["x"], clean["y"], true)
    entries = np.flatnonzero(touched)[:: knots // 6]
    coefficients, search = problem.searched(iterations, entries.tolist())
    fitted = np.asarray(cj.profiles.PeriodicSpline(coefficients).at(angles).value)
    return Wall(angles, true, fitted, touched, record["x"], record["y"], search)


def _touched(x: np.ndarray, y: np.ndarray, wall: np.ndarray) -> np.ndarray:
    """Return whether the journal, at positions (n,), touched the wall at each of its knots."""
    at, knots = np.arctan2(y, x), len(wall)
    profile = np.asarray(cj.profiles.PeriodicSpline.through(wall).at(at).value)
    nearest = np.round(at * knots / (2.0 * np.pi)).astype(int) % knots
    return np.isin(np.arange(knots), nearest[np.hypot(x, y) > CLEARANCE + profile])


def table(wall: Wall) -> list[tuple[str, ...]]:
    """Return the table of the fit as text."""
    (rms, largest), (rms_free, largest_free) = map(wall.error, (wall.touched, ~wall.touched))
    micro = 1.0 / MICROMETRE
    return [
        ("quantity", "value"),
        ("knots; touched by the journal", f"{len(wall.true)}; {wall.touched.sum()}"),
        ("deepest wear, µm", f"{micro * wall.true.max():.0f}"),
        ("error where touched, rms; largest, µm", f"{micro * rms:.2g}; {micro * largest:.2g}"),
        (
            "error elsewhere, rms; largest, µm",
            f"{micro * rms_free:.2g}; {micro * largest_free:.2g}",
        ),
    ]


def figure(wall: Wall) -> Figure:
    """Draw the walls over the angle, with the touched sector, and the recorded orbit."""
    drawn = Figure(figsize=(9.0, 3.8), layout="constrained")
    left, right = drawn.subplots(1, 2, width_ratios=(2, 1))
    order = np.argsort((wall.angles + 0.5 * np.pi) % (2.0 * np.pi))
    degrees = np.rad2deg((wall.angles + 0.5 * np.pi) % (2.0 * np.pi) - 0.5 * np.pi)[order]
    half = 180.0 / len(degrees)
    for at in degrees[wall.touched[order]]:
        left.axvspan(at - half, at + half, color=style.LIGHT, alpha=0.6, linewidth=0.0)
    left.plot(degrees, wall.true[order] / MICROMETRE, color=style.VERMILLION, label="true wall")
    left.plot(
        degrees, wall.fitted[order] / MICROMETRE, "o", color=style.BLUE, markersize=4,
        label="fitted, from a circle",
    )  # fmt: skip
    left.set_xticks(np.arange(-90, 271, 60))
    left.legend()
    left.set_title("touched sector shaded", fontsize=9)
    style.dress(left, "angle in the bearing, °", "depth of wear, µm")
    right.plot(wall.x / MICROMETRE, wall.y / MICROMETRE, ".", color=style.DARK, markersize=3)
    right.set_aspect("equal")
    style.dress(right, "recorded journal offset x, µm", "y, µm")
    return drawn
