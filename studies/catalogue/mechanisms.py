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


def checks(quick: bool) -> list[Check]:
    """Each mechanism; the quick ones by themselves."""
    rows = [_double_pendulum()]
    return rows if quick else [*rows, _double_four_bar(), _bricard()]


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
