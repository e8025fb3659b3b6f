"""Mechanisms: published end points, and the first impacts of an event-exact solver."""

import diffrax
import jax
import numpy as np
from jax.scipy.spatial.transform import Rotation

import clearjoint as cj
from studies.catalogue.check import Check

TIGHT = cj.Settings(solver=diffrax.Dopri8(), rtol=1e-10, stabilisation=cj.Projection())
FIRST_IMPACTS = {
    "onset": (10.096e-3, 28.745e-3, 45.749e-3),
    "entry_speed": (0.09905, 0.09028, 0.08209),
    "peak_force": (1466.4, 1313.6),
}
"""Of the paper's pendulum: s, m/s and N of a base."""

LENGTHS = (0.1, 0.3, 0.25, 0.3)
"""Of the four-bar: crank, coupler, rocker and ground, m."""
SQUEEZED = (
    15.81077119629904,
    -15.75637105984298,
    0.04082224013073101,
    -0.5347301163226948,
    0.5244099658805304,
    0.5347301163226948,
    1.048080741042263,
)
"""Angles of Andrews' mechanism, rad."""


def checks(quick: bool) -> list[Check]:
    """Each mechanism; none is quick."""
    if quick:
        return []
    return [_double_pendulum(), _double_four_bar(), _bricard(), _squeezer(), _four_bar()]


def place(scene: cj.Scene, state: cj.State, end: float, body: str, local: tuple) -> np.ndarray:
    """Where a point of a body (body axes) is at the end of a run, m."""
    body_at = cj.simulate(scene, state, end, TIGHT, progress=False).final.bodies[body]
    e = np.asarray(body_at.orientation)
    turn = Rotation.from_quat(jax.numpy.asarray([*e[1:], e[0]]))
    return np.asarray(body_at.position) + np.asarray(turn.apply(jax.numpy.asarray(local)))


def _double_pendulum() -> Check:
    impacts = cj.simulate(
        *cj.double_pendulum(), 0.06, save=cj.Saving(impacts=True), progress=False
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


def _double_four_bar() -> Check:
    found = place(*cj.double_four_bar(), 10.0, "rod 1", (0.5, 0.0, 0.0))
    off = float(np.abs(found[:2] - (0.328458111536, 0.944518538180)).max())
    against = "tip of the first rod after 10 s: independent solution, m"
    return Check("double_four_bar", "IFToMM benchmark A02", against, off, 1e-6, "")


def _bricard() -> Check:
    found = place(*cj.bricard(), 2.0, "rod 2", (0.0, -0.5, 0.0))
    off = float(np.abs(found - (-0.7781353730, -0.9803526834, -0.1972526706)).max())
    against = "a corner after 2 s: independent least-squares solver, m"
    return Check("bricard", "IFToMM benchmark A04", against, off, 1e-7, "")


def _squeezer() -> Check:
    bodies = cj.simulate(*cj.andrews_squeezer(), 0.03, TIGHT, progress=False).final.bodies
    e = {name: np.asarray(body.orientation) for name, body in bodies.items()}
    k = [2.0 * np.arctan2(e[f"K{n}"][3], e[f"K{n}"][0]) for n in range(1, 8)]
    found = np.array(k) - np.array([0.0, k[0], 0.0, k[4], 0.0, k[6], 0.0])
    off = found - np.array(SQUEEZED)
    off = float(np.abs(off - 2.0 * np.pi * np.round(off / (2.0 * np.pi))).max())
    against = "seven angles after 0.03 s: IVP test set, rad"
    return Check("andrews_squeezer", "Andrews; Schiehlen 1990", against, off, 1e-7, "")


def _four_bar() -> Check:
    """Freudenstein's equation at the start and after half a turn of the crank."""
    scene, state = cj.four_bar(lengths=LENGTHS, speed=5.0)
    final = cj.simulate(scene, state, 0.6, TIGHT, progress=False).final
    off = max(_freudenstein(here.bodies) for here in (state, final))
    against = "angles of crank and rocker: Freudenstein's equation"
    return Check("four_bar", "Freudenstein 1954", against, off, 1e-9, "")


def _freudenstein(bodies: dict[str, cj.BodyState]) -> float:
    turned = {
        name: 2.0 * np.arctan2(*np.asarray(body.orientation)[[3, 0]])
        for name, body in bodies.items()
    }
    crank, rocker = turned["crank"], turned["rocker"]
    a, b, c, d = LENGTHS
    ratios = d / a, d / c, (a * a - b * b + c * c + d * d) / (2.0 * a * c)
    left = ratios[0] * np.cos(rocker) - ratios[1] * np.cos(crank) + ratios[2]
    return float(abs(left - np.cos(crank - rocker)))
