"""Mechanisms against published values, closed forms and an event-exact solver."""

import diffrax
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation
from scipy.special import ellipj, ellipk

import clearjoint as cj
from clearjoint.plot import style
from studies.catalogue.check import Check
from studies.catalogue.overlay import Compared, legend, overlay

TIGHT = cj.Settings(solver=diffrax.Dopri8(), rtol=1e-10, stabilisation=cj.Projection())
FIRST_IMPACTS = {
    "onset": (10.096e-3, 28.745e-3, 45.749e-3),
    "entry_speed": (0.09905, 0.09028, 0.08209),
    "peak_force": (1466.4, 1313.6),
}
"""First impacts of the paper's pendulum: s, m/s and N of a base."""

LENGTHS = (0.1, 0.3, 0.25, 0.3)
"""Lengths of the four-bar: crank, coupler, rocker and ground, m."""
TIP = (0.328458111536, 0.944518538180)
"""Tip of the double four-bar's first rod after 10 s, m."""
CORNERS = {
    0.5: (0.7747178080, -0.9798150477, -0.1999061590),
    1.0: (0.2744813193, -0.8867079387, -0.4623300027),
    2.0: (-0.7781353730, -0.9803526834, -0.1972526706),
}
"""Corner of Bricard's mechanism, m, at times in s."""
SQUEEZED = (
    15.81077119629904,
    -15.75637105984298,
    0.04082224013073101,
    -0.5347301163226948,
    0.5244099658805304,
    0.5347301163226948,
    1.048080741042263,
)
"""Angles of Andrews' mechanism after 0.03 s, rad."""
FIGURE = "[mechanisms](mechanisms.png)"


def checks(quick: bool) -> list[Check]:
    """Check each mechanism; none is quick."""
    if quick:
        return []
    return [_double_pendulum(), _double_four_bar(), _bricard(), _squeezer(), _four_bar()]


def path(scene: cj.Scene, state: cj.State, times: np.ndarray) -> dict[str, cj.BodyState]:
    """Return the bodies at times (T,), s; the last time is the end of the run."""
    save = cj.Saving(times)
    return cj.simulate(scene, state, times[-1], TIGHT, save, progress=False).states.bodies


def position(body: cj.BodyState, local: tuple[float, float, float]) -> np.ndarray:
    """Return the positions of a point given in body axes, (3, T) m."""
    turns = Rotation.from_quat(np.asarray(body.orientation), scalar_first=True)
    return (np.asarray(body.position) + turns.apply(local)).T


def turned(body: cj.BodyState) -> np.ndarray:
    """Return the angle of a body about Z, (T,) rad."""
    orientation = np.asarray(body.orientation)
    return 2.0 * np.arctan2(orientation[:, 3], orientation[:, 0])


def wrapped(angle: np.ndarray) -> np.ndarray:
    """Return angles between -pi and pi, rad."""
    return angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi))


def _double_pendulum() -> Check:
    impacts = cj.simulate(
        *cj.mechanisms.double_pendulum(), 0.06, save=cj.Saving(impacts=True), progress=False
    ).impacts
    assert impacts is not None
    base = impacts.of("shoulder", "V")
    off = max(
        float(np.abs(getattr(base, name)[: len(values)] / values - 1.0).max())
        for name, values in FIRST_IMPACTS.items()
    )
    against = "onset, speed and force of the first impacts: event-exact solver, five digits"
    figure = "[first impacts](../double_pendulum/figure_17.png)"
    return Check("double_pendulum", "the paper, section 6", against, off, 1e-4, figure)


def double_four_bar() -> Compared:
    """Return the tip of the first rod, m, over time, s.

    With all five rods parallel the mechanism is a pendulum, which starts on top at 1 rad/s: its
    angle is Jacobi's amplitude.
    """
    times = np.linspace(0.0, 10.0, 401)
    tip = position(path(*cj.mechanisms.double_four_bar(), times)["rod 1"], (0.5, 0.0, 0.0))[:2]
    square = 3.5 * 9.81 / 3.0
    below = np.sqrt(1.0 + 4.0 * square)
    modulus = 4.0 * square / below**2
    half = ellipj(0.5 * below * times + ellipk(modulus), modulus)[3]
    return Compared.along(times, tip, np.stack([-np.sin(2.0 * half), -np.cos(2.0 * half)]))


def _double_four_bar() -> Check:
    compared = double_four_bar()
    off = max(compared.off(), float(np.abs(compared.found[:, -1] - TIP).max()))
    against = "tip of the first rod for 10 s: pendulum in closed form, and independent solution, m"
    return Check("double_four_bar", "IFToMM benchmark A02", against, off, 1e-6, FIGURE)


def bricard() -> Compared:
    """Return a corner of Bricard's mechanism, m, over time, s."""
    times = np.linspace(0.0, 2.0, 101)
    corner = position(path(*cj.mechanisms.bricard(), times)["rod 2"], (0.0, -0.5, 0.0))
    return Compared(times, corner, np.array(list(CORNERS)), np.transpose(list(CORNERS.values())))


def _bricard() -> Check:
    against = "a corner at 0.5, 1 and 2 s: independent least-squares solver, m"
    return Check("bricard", "IFToMM benchmark A04", against, bricard().off(), 1e-7, FIGURE)


def squeezer() -> Compared:
    """Return the seven angles of Andrews' mechanism between -pi and pi, rad, over time, ms."""
    times = np.linspace(0.0, 0.03, 301)
    bodies = path(*cj.mechanisms.andrews_squeezer(), times)
    k = np.stack([turned(bodies[f"K{n}"]) for n in range(1, 8)])
    angles = k - np.stack([0.0 * k[0], k[0], 0.0 * k[0], k[4], 0.0 * k[0], k[6], 0.0 * k[0]])
    end = wrapped(np.array(SQUEEZED))[:, None]
    return Compared(1e3 * times, wrapped(angles), np.array([30.0]), end)


def _squeezer() -> Check:
    against = "seven angles after 0.03 s: IVP test set, rad"
    return Check(
        "andrews_squeezer", "Andrews; Schiehlen 1990", against, squeezer().off(), 1e-7, FIGURE
    )


def four_bar() -> Compared:
    """Return the angle of the rocker over that of the crank, rad.

    Freudenstein's equation K1 cos(rocker) - K2 cos(crank) + K3 = cos(crank - rocker) is solved for
    the rocker.
    """
    times = np.linspace(0.0, 1.2, 241)
    bodies = path(*cj.mechanisms.four_bar(lengths=LENGTHS, speed=5.0), times)
    crank, rocker = np.unwrap(turned(bodies["crank"])), turned(bodies["rocker"])
    a, b, c, d = LENGTHS
    ratios = d / a, d / c, (a * a - b * b + c * c + d * d) / (2.0 * a * c)
    x, y = np.cos(crank) - ratios[0], np.sin(crank)
    share = (ratios[2] - ratios[1] * np.cos(crank)) / np.hypot(x, y)
    return Compared.along(crank, rocker, wrapped(np.arctan2(y, x) - np.arccos(share)))


def _four_bar() -> Check:
    against = "angle of the rocker for 1.2 s, rad: Freudenstein's equation"
    return Check("four_bar", "Freudenstein 1954", against, four_bar().off(), 1e-9, FIGURE)


def figure() -> Figure:
    """Draw motions of the mechanisms and their published values or closed forms."""
    drawn, panels = plt.subplots(2, 2, figsize=(10.0, 6.8), layout="constrained")
    (left, right), (below, last) = panels
    overlay(left, double_four_bar(), "xy", every=10)
    style.dress(left, "time, s", "double four-bar: tip of rod 1, m")
    overlay(right, bricard(), "xyz")
    style.dress(right, "time, s", "Bricard's mechanism: a corner, m")
    squeezed = squeezer()
    turns = np.abs(np.diff(squeezed.found, append=squeezed.found[:, -1:])) > np.pi
    cut = squeezed._replace(found=np.where(turns, np.nan, squeezed.found))
    overlay(below, cut, ("β", "Θ", "γ", "Φ", "", "δ, Ω", "ε"))
    style.dress(below, "time, ms", "Andrews' squeezer: angles less turns, rad")
    overlay(last, four_bar(), every=8)
    style.dress(last, "angle of the crank, rad", "four-bar: angle of the rocker, rad")
    legend(drawn, left)
    return drawn
