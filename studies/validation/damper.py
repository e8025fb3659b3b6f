"""A friction damper with backlash, fitted to measured records.

The records are those of ARTS-Laboratory/Dataset-Friction-Damper-with-Backlash on GitHub (CC BY-SA
4.0); this project contains none of them. A drum is braked by a band and moved to and fro through a
joint with play. A file is a JSON object whose "data" is a list of rows: time in s, displacement in
inches, force in kip, and further columns.
"""

import json
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint import plot
from clearjoint.extend import Scalar
from clearjoint.plot import style
from studies.validation.identification import Floor

UNITS = {"time units": "s", "displacement units": "in", "friction force units": "kip"}
INCH, KIP = 0.0254, 4448.2216152605
"""m; N."""
MASS, DAMPING = 100.0, 2e3
"""Mass of the drum, kg, and damping of the contact, N s/m, which the records do not determine."""
WEIGHT, FLOOR_STIFFNESS, DEFLECTION = 1e3, 1e7, 2e-5
"""Weight of the drum, N, stiffness of the floor below it, N/m, and deflection of the bristles of
the friction in sliding, m."""
BLOCK = 16
"""Number of samples over which the displacement is averaged."""
SAMPLES = 400
"""Number of forces that are fitted in a period."""
SMALL = 1e3
"""Force, N, below which the travel is read off."""
SCATTER = 500.0
"""Standard deviation of what the scene leaves out, N, mostly vibrations of the band."""
GUESS = {"play": 2.5e-3, "stiffness": 2e6, "friction": 9e3}
"""m, N/m, N, N."""
X, Y, ORIGIN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.0)


class Record(NamedTuple):
    """Times, s, displacements, m, and forces, N, each (N,)."""

    time: np.ndarray
    displacement: np.ndarray
    force: np.ndarray

    @property
    def noise(self) -> float:
        """Standard deviation of the noise of the force, N, from the first tenth of a second."""
        return float(np.std(np.diff(self.force[:100], 2)) / np.sqrt(6.0))


class DamperFit(NamedTuple):
    """Fit of a period of a record.

    - `name`: of the file; `record`: the whole record.
    - `estimates`: values of the parameters in `GUESS`.
    - `time`, `displacement`, `force`, `fitted`: (N,) s, m, N and N, of the period.
    """

    name: str
    record: Record
    estimates: dict[str, float]
    time: np.ndarray
    displacement: np.ndarray
    force: np.ndarray
    fitted: np.ndarray

    def free_travel(self, force: np.ndarray) -> float:
        """Return the mean travel at a reversal, m, in which a force (N,), N, is below `SMALL`."""
        small = np.abs(force[1:]) < SMALL
        return 0.5 * float(np.abs(np.diff(self.displacement))[small].sum())

    @property
    def rms(self) -> float:
        """Root mean square of the residuals, N."""
        return float(np.sqrt(np.mean((self.fitted - self.force) ** 2)))


def read(path: Path) -> Record:
    """Return the record in a file.

    **Raises:** `ValueError` for a file that cannot be read, or that does not have the format.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ValueError(
            f"{path} is not a JSON file ({error}): give a file of the data."
        ) from error
    units = {name: content.get(name) for name in UNITS} if isinstance(content, dict) else None
    if units != UNITS:
        raise ValueError(f"{path} has the units {units}, where {UNITS} is expected.")
    try:
        rows = np.asarray(content.get("data"), dtype=float)
    except (TypeError, ValueError):  # rows of unequal lengths, or text
        rows = np.zeros((0, 0))
    if rows.ndim != 2 or rows.shape[1] < 3 or not np.isfinite(rows[:, :3]).all():
        raise ValueError(
            f'"data" of {path} has the shape {rows.shape}: rows of at least three finite numbers,'
            " time, displacement and force, are expected."
        )
    return Record(rows[:, 0], INCH * rows[:, 1], KIP * rows[:, 2])


def contact_force(now: cj.extend.Instant) -> Scalar:
    """Return the force on the drum forwards, N."""
    behind, ahead = (
        cj.quantities.ContactForce("play", wall)(now) for wall in ("lower wall", "upper wall")
    )
    return behind - ahead


def damper(path: cj.Spline) -> cj.Scene:
    """Return a drum and a fork that moves along a path, m, with the play between them.

    The drum's friction is that of bristles on a floor, because a smooth function of the speed would
    let the drum creep while it should stick. The weight on the floor is 1 kN, so that the
    coefficient of friction is the friction in kN. A constant force makes the friction in the two
    directions different.
    """
    law = cj.laws.ElastoGap(GUESS["stiffness"], damping=DAMPING)
    coefficient = GUESS["friction"] / WEIGHT
    friction = cj.frictions.Dahl(coefficient, stiffness=coefficient / DEFLECTION)
    joints = {
        "fork's rail": cj.PrismaticJoint("ground", "fork", ORIGIN, ORIGIN, X),
        "band": Floor("drum", cj.laws.Hertz(FLOOR_STIFFNESS, exponent=1.0), friction),
        "drive": cj.PrescribedTranslation("ground", "fork", ORIGIN, ORIGIN, X, path),
        "play": cj.PinInSlot(
            "fork",
            "drum",
            slot_axis=Y,
            slot_normal=X,
            play=GUESS["play"],
            pin_radius=0.05,  # m; the penetration of a pin may be up to its radius
            law=law,
        ),
    }
    bodies = {"fork": cj.Body(1.0, (1.0, 1.0, 1.0)), "drum": cj.Body(MASS, (1.0, 1.0, 1.0))}
    offset = cj.AppliedLoad("drum", force=(0.0, 0.0, 0.0))
    gravity = (0.0, 0.0, -WEIGHT / MASS)
    return cj.Scene(bodies, joints, {"offset": offset}, gravity)


PARAMETERS = {
    "play": cj.Parameter(lambda s: s.joints["play"].play, cj.Log()),
    "stiffness": cj.Parameter(lambda s: s.joints["play"].law.stiffness.stiffness, cj.Log()),
    "friction": cj.Parameter(lambda s: s.joints["band"].friction.coefficient, cj.Log()),
    "offset": cj.Parameter(lambda s: s.forces["offset"].force[0], cj.Linear(1e3)),
}


def fit_damper(path: Path) -> DamperFit:
    """Fit play, stiffness and friction to one period in the middle of a record."""
    record = read(path)
    count = len(record.time) // BLOCK
    time, place = (
        values[: count * BLOCK].reshape(count, BLOCK).mean(axis=1)
        for values in (record.time, record.displacement)
    )
    rises = np.flatnonzero((place[:-1] < 0.0) & (place[1:] >= 0.0))
    if len(rises) < 4:
        raise ValueError(
            f"{path} has {len(rises)} rises of the displacement through zero: at least four are"
            " needed, for the period between two of them."
        )
    begin, end = rises[len(rises) // 2 - 1 : len(rises) // 2 + 1]
    # The run starts half a period earlier, so that the drum slides where the samples begin.
    first = begin - (end - begin) // 2
    near = slice(first - 8, end + 8)
    spline = cj.Spline.through(time[near], place[near])
    at = (float(place[first]), 0.0, 0.0)
    fork = cj.body_state(at, velocity=(float(spline.rates[8]), 0.0, 0.0))
    drum = cj.body_state((at[0], 0.0, -WEIGHT / FLOOR_STIFFNESS))
    start = cj.State({"fork": fork, "drum": drum})
    scene, start_time = damper(spline), float(time[first])
    times = np.linspace(time[begin], time[end], SAMPLES + 1)[1:]
    force = np.interp(times, record.time, record.force)
    series = cj.Series(contact_force, times, force, SCATTER, "N", path.name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cj.PoorFitWarning)
        fit = cj.identify(
            scene,
            start,
            cj.Measurements({"force": series}),
            PARAMETERS,
            start_time=start_time,
            tolerance=1e-2,
            check_runs=0,
            progress=False,
        )
    solution = cj.simulate(
        fit.scene, start, times[-1], save=cj.Saving(times), start_time=start_time, progress=False
    )
    fitted = np.asarray(plot.series(fit.scene, solution, contact_force, unit="N"))
    shown = np.interp(times, time, place)
    band, offset = WEIGHT * fit.estimates["friction"], -fit.estimates["offset"]
    estimates = {
        "play": fit.estimates["play"],
        "stiffness": fit.estimates["stiffness"],
        "forwards": band + offset,
        "backwards": band - offset,
    }
    return DamperFit(path.name, record, estimates, times, shown, force, fitted)


def damper_table(fits: Sequence[DamperFit]) -> list[list[str]]:
    """Return the table of fits as text."""
    head = [
        "record",
        "play, mm",
        "travel below 1 kN, mm: fitted",
        "measured",
        "stiffness, kN/mm",
        "friction forwards, kN",
        "friction backwards, kN",
        "residual rms, kN",
        "noise of the force, kN",
    ]
    rows = [
        [
            fit.name,
            f"{1e3 * fit.estimates['play']:.2f}",
            f"{1e3 * fit.free_travel(fit.fitted):.2f}",
            f"{1e3 * fit.free_travel(fit.force):.2f}",
            f"{1e-6 * fit.estimates['stiffness']:.2f}",
            f"{1e-3 * fit.estimates['forwards']:.2f}",
            f"{1e-3 * fit.estimates['backwards']:.2f}",
            f"{1e-3 * fit.rms:.2f}",
            f"{1e-3 * fit.record.noise:.3f}",
        ]
        for fit in fits
    ]
    return [head, *rows]


def damper_figure(fits: Sequence[DamperFit]) -> Figure:
    """Draw measured and fitted forces over the displacement."""
    drawn, panels = plt.subplots(
        1, len(fits), figsize=(4.0 * len(fits), 3.4), layout="tight", squeeze=False
    )
    for fit, panel in zip(fits, panels[0], strict=True):
        panel.plot(1e3 * fit.displacement, 1e-3 * fit.force, color="0.5", label="measured")
        panel.plot(1e3 * fit.displacement, 1e-3 * fit.fitted, color=style.BLUE, label="fitted")
        panel.set(title=fit.name, xlabel="displacement, mm", ylabel="force, kN")
        panel.grid(alpha=0.3)
    panels[0, 0].legend()
    return drawn
