"""Solution of a run with rigid contacts."""

from typing import TYPE_CHECKING

import equinox as eqx
import numpy as np

from ...dynamics.formulation import Formulation
from ...export.tabular import AbstractTabular
from ...fields.checks import require
from ...fields.readable import AbstractReadable
from ...model.bodies import State
from ...result_codes import RESULTS
from ..step.types import Integers, Numbers
from .solution import Trajectory, is_abstract, run_text
from .state_tables import contact_label

if TYPE_CHECKING:
    import xarray as xr

RIGID = "rigid_contact"
TOTAL_UNITS = {
    "impacts": "1",
    "impulse": "N s",
    "dissipated": "J",
    "hardest": "N s",
    "fastest": "m/s",
    "penetration": "m",
}
"""Units of the fields of `ContactTotals`."""


class ContactTotals(AbstractReadable):
    """Totals of a rigid contact since the start of the run.

    - `impacts`: number of steps with an impulse that follow a step without. A rolling contact may
      hop, which counts each time.
    - `impulse`: sum of the normal impulses, N s. There is no peak force, since an impact has no
      duration.
    - `dissipated`: energy dissipated by restitution and friction, J.
    - `hardest`: largest impulse in a step, N s.
    - `fastest`: largest approach speed of an impact, m/s.
    - `penetration`: largest penetration in the middle of a step, m.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> totals = cj.simulate_nonsmooth(scene, state, 0.02, step=1e-4).contacts["shoulder"]["V"]
    >>> bool(totals.impulse > 0.0)
    True
    """

    impacts: Integers
    impulse: Numbers
    dissipated: Numbers
    hardest: Numbers
    fastest: Numbers
    penetration: Numbers


class NonsmoothSolution(AbstractReadable, AbstractTabular):
    """The outcome of `clearjoint.simulate_nonsmooth`.

    - `time`, `final`, `result`: as of `Solution`.
    - `steps`: number of steps.
    - `saved`: the states at the requested times, and `history[joint][contact]` the `ContactTotals`
      up to each of these times, both ``None`` if no times were requested. The first `saved_count`
      rows were reached; the others repeat the last state.
    - `contacts[joint][contact]`: the `ContactTotals` of the run.
    - `residual`: largest violation of the contacts' laws in a step, over its largest velocity.
    - `formulation`, `redundant_constraints`: as of `Solution`.

    `observe` accepts it too, but its forces have no meaning. `to_xarray`, `to_dataframe`, `to_csv`
    and `to_netcdf` export the saved states and the history.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> solution = cj.simulate_nonsmooth(scene, state, 0.02, step=1e-4)
    >>> int(solution.steps)
    200
    """

    time: Numbers
    final: State
    result: RESULTS
    steps: Integers
    saved: Trajectory | None
    history: dict[str, dict[str, ContactTotals]] | None
    saved_count: Integers | None
    contacts: dict[str, dict[str, ContactTotals]]
    residual: Numbers
    formulation: Formulation
    redundant_constraints: tuple[str, ...] = eqx.field(static=True)

    def __repr__(self) -> str:
        """Return a few lines: how the run ended, its results, and the bodies' final states."""
        if is_abstract(self):
            return super().__repr__()
        lines = [f"{self.steps} steps"]
        if self.saved is not None:
            lines.append(f"saved: {self.saved}")
        for joint, family in self.contacts.items():
            counts = (f"{one.impacts} at {contact!r}" for contact, one in family.items())
            lines.append(f"impacts of {joint!r}: {', '.join(counts)}")
        return run_text(self, self.final, self.redundant_constraints, lines)

    def to_xarray(self) -> "xr.Dataset":
        """Return an `xarray.Dataset` of the saved states, see `Trajectory.to_xarray`.

        The contacts' totals up to each time are included along "rigid_contact".

        **Raises:** `ValueError` for a run that saved no states.
        """
        times = "pass times to simulate_nonsmooth()"
        require(self.saved is not None, "solution", "without saved states", "with some", times)
        assert self.saved is not None and self.history is not None
        found = self.saved.to_xarray()
        contacts = {
            contact_label(joint, contact): totals
            for joint, family in self.history.items()
            for contact, totals in family.items()
        }
        dims = "time", RIGID
        totals = {
            name: (dims, np.stack([np.asarray(getattr(c, name)) for c in contacts.values()], 1))
            for name in TOTAL_UNITS
            if contacts
        }
        for name, (_, values) in totals.items():
            found[name] = (dims, values, {"units": TOTAL_UNITS[name]})
        found = found.assign_coords({RIGID: list(contacts)}) if contacts else found
        notes = {
            "title": "motion of a mechanism with rigid contacts",
            "result": RESULTS[self.result],
            "time_reached": float(self.time),
            "steps": int(self.steps),
        }
        reached = len(found["time"]) if self.saved_count is None else int(self.saved_count)
        return found.isel(time=slice(reached)).assign_attrs(notes)
