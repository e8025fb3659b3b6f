"""Gear rattle of the pair of Kahraman and Singh, whose teeth part near resonance.

Their equation of the relative displacement q, in units of half the backlash and of the resonance,

    q'' + 2 zeta q' + k(phi) g(q) = f_m + f_ah omega^2 cos(phi),  phi = omega t

with the force g of a spring with backlash, holds exactly for a first gear that turns at constant
speed.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from scipy.integrate import solve_ivp

import clearjoint as cj
from clearjoint.plot import style
from studies.catalogue.check import Check

Z_AXIS = (0.0, 0.0, 1.0)
TEETH, MODULE, BACKLASH, STIFFNESS = (20, 50), 3e-3, 1e-4, 4e8
BASE_RADII = [0.5 * MODULE * teeth * math.cos(math.radians(20.0)) for teeth in TEETH]
HALF = 0.5 * BACKLASH * math.cos(math.radians(20.0))
"""Half of the backlash along the line of action, m."""
DAMPING, MEAN, ERROR, VARIATION = 0.05, 0.1, 0.05, -0.1
"""zeta, f_m and f_ah of the pair, and a of its stiffness k = 1 + a cos(phi)."""
PERIODS, SAMPLES = 60, 401
"""Mesh cycles until a motion has settled, and times in the one after them."""
FREQUENCIES = (0.65, 0.7, 0.75, 0.8)
"""Frequencies of the mesh over that of its resonance. With rising speed the motion jumps, and the
teeth begin to part, above 0.75; with falling speed it jumps back below 0.7."""

DRAWN = np.linspace(0.5, 1.2, 57)
"""Frequencies of the figure, over that of the resonance."""


class MeshDamping(cj.extend.AbstractDriveTorque):
    """Torque of the damping of the mesh on the second gear, in contact and in flight.

    - `coefficient`: N s/m. `radius`: the base radius of the second gear, m.
    - `driven`: speed of the first gear's base circle, m/s.
    - `error`: amplitude, m, of the transmission error; `frequency`: of the mesh, rad/s.
    """

    first: str
    second: str
    axis: tuple[float, float, float]
    orientation: tuple[float, float, float, float]
    coefficient: float
    radius: float
    driven: float
    error: float
    frequency: float

    def torque_at(self, angle, speed, t):
        """Return the torque at a speed of the second gear, N m."""
        error_rate = -self.error * self.frequency * jnp.sin(self.frequency * t)
        rate = self.driven + self.radius * speed - error_rate
        return -self.coefficient * self.radius * rate


def rattle(frequency: float, q: float, rate: float) -> tuple[cj.Scene, cj.State, float]:
    """Return the gears at a frequency of the mesh, their state at a displacement and its rate, and
    the resonance, rad/s."""
    law = cj.laws.Hertz(STIFFNESS, exponent=1.0)
    scene, state = cj.mechanisms.gear_pair(BACKLASH, teeth=TEETH, module=MODULE, law=law)
    mesh = replace(
        scene.joints["mesh"],
        stiffness=cj.profiles.StiffnessHarmonics([VARIATION]),
        transmission_error=cj.profiles.Harmonics([ERROR * HALF]),
    )
    first, second = BASE_RADII
    mass = float(scene.bodies["wheel"].inertia[2]) / second**2
    resonance = math.sqrt(STIFFNESS / mass)
    speed = frequency * resonance / TEETH[0]
    damping = MeshDamping(
        *("ground", "wheel", Z_AXIS, (1.0, 0.0, 0.0, 0.0)),
        coefficient=2.0 * DAMPING * math.sqrt(STIFFNESS * mass),
        radius=second,
        driven=first * speed,
        error=ERROR * HALF,
        frequency=frequency * resonance,
    )
    drive = cj.PrescribedRotation("ground", "pinion", Z_AXIS, speed)
    load = cj.DriveTorque("ground", "wheel", Z_AXIS, MEAN * STIFFNESS * HALF * second)
    joints = {**scene.joints, "mesh": mesh, "drive": drive}
    angle = (q + ERROR) * HALF / second
    turn = (math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle))
    spin = (rate * HALF * resonance - first * speed) / second
    wheel = cj.body_state(state.bodies["wheel"].position, turn, spin=(0.0, 0.0, spin))
    pinion = cj.body_state((0.0, 0.0, 0.0), spin=(0.0, 0.0, speed))
    bodies = {"pinion": pinion, "wheel": wheel}
    loaded = cj.Scene(scene.bodies, joints, {"damping": damping, "load": load})
    return loaded, cj.State(bodies), resonance


def settled(frequency: float, q: float, rate: float) -> np.ndarray:
    """Return the displacement and its rate in a mesh cycle after many, (2, SAMPLES)."""
    scene, state, resonance = rattle(frequency, q, rate)
    cycle = math.tau / (frequency * resonance)
    flank = "mesh", "upper flank"
    depth, sinking = cj.quantities.Penetration(*flank), cj.quantities.PenetrationRate(*flank)
    times = cycle * (PERIODS + np.linspace(0.0, 1.0, SAMPLES))
    run = cj.simulate(
        scene,
        state,
        times[-1],
        cj.Settings(rtol=1e-10, atol=1e-12),
        cj.Saving(times),
        outputs={"depth": depth, "rate": sinking},
        progress=False,
    )
    depths, rates = (np.asarray(run.outputs[name]) for name in ("depth", "rate"))
    return np.stack([depths / HALF + 1.0, rates / (HALF * resonance)])


def integrated(frequency: float, q: float, rate: float) -> np.ndarray:
    """Return the same by SciPy, from the equation."""

    def rates(t: float, y: np.ndarray) -> list[float]:
        wave = math.cos(frequency * t)
        spring = y[0] - min(max(y[0], -1.0), 1.0)
        load = MEAN + ERROR * frequency**2 * wave
        return [y[1], load - 2.0 * DAMPING * y[1] - (1.0 + VARIATION * wave) * spring]

    cycle = math.tau / frequency
    times = cycle * (PERIODS + np.linspace(0.0, 1.0, SAMPLES))
    run = solve_ivp(
        *(rates, (0.0, times[-1]), (q, rate)),
        method="DOP853",
        t_eval=times,
        rtol=1e-10,
        atol=1e-12,
        max_step=0.05 * cycle,
    )
    return run.y


def swept(settle: Callable[..., np.ndarray], frequencies: Iterable[float]) -> np.ndarray:
    """Return half of the range of the displacement at each frequency, after the one before it; at
    first the teeth touch at rest."""
    amplitudes, last = [], (1.0 + MEAN, 0.0)
    for frequency in frequencies:
        motion = settle(frequency, *last)
        last = motion[:, -1]
        amplitudes.append(0.5 * np.ptp(motion[0]))
    return np.array(amplitudes)


def check(quick: bool) -> Check:
    """Check the amplitudes below, between and above the jumps, with rising and falling speed."""
    largest = 0.0
    for frequencies in [FREQUENCIES[:1]] if quick else (FREQUENCIES, FREQUENCIES[::-1]):
        expected = swept(integrated, frequencies)
        largest = max(largest, float(np.abs(swept(settled, frequencies) / expected - 1.0).max()))
    against = "amplitudes of gear rattle on both sides of its jumps: SciPy's DOP853"
    entry, source = "GearBacklash(stiffness=, transmission_error=)", "Kahraman, Singh 1990, 1991"
    return Check(entry, source, against, largest, 1e-6, "[clearance joints](plays.png)")


def draw(axes: Axes) -> None:
    """Draw the amplitude of the rattle with rising and falling speed."""
    ways = (("rising speed", 1, style.BLUE, "o"), ("falling speed", -1, style.VERMILLION, "s"))
    for label, sense, colour, marker in ways:
        line, points = DRAWN[::sense], FREQUENCIES[::sense]
        axes.plot(line, swept(settled, line), color=colour, label=label)
        name = "SciPy" if sense > 0 else None
        axes.plot(points, swept(integrated, points), marker, color=colour, mfc="none", label=name)
    style.dress(axes, "frequency of the mesh / resonance", "amplitude / half the backlash")
