"""Result of `simulate_nonsmooth`, a run with rigid contacts, whose impacts have no duration."""

from dataclasses import fields
from typing import TYPE_CHECKING

import equinox as eqx
import numpy as np
from typing_extensions import override

from ..._dynamics.formulation import Formulation
from ..._export.datasets import AbstractTabular
from ..._fields.checks import require
from ..._fields.objects import AbstractReadable, described
from ..._model.bodies import State
from ..._result_codes import RESULTS
from ..step.types import Integers, Numbers
from .solution import Trajectory, by_contact, is_abstract, run_text

if TYPE_CHECKING:
    import xarray as xr

RIGID = "rigid_contact"
"""Name of the dimension along which rigid contacts are listed."""


class ContactTotals(AbstractReadable):
    """Sums and extreme values of one rigid contact since the start of the run.

    Each field is a number; in `NonsmoothSolution.history`, with N times, it is an array (N,).

    - `impacts`: number of impacts, which are steps with a normal impulse after a step without one.
      A rolling contact may hop, and each hop counts.
    - `impulse`: N s, sum of the normal impulses.
    - `dissipated`: J, energy dissipated by restitution and friction.
    - `hardest`: N s, largest normal impulse of a step.
    - `fastest`: m/s, largest approach speed in a step with an impulse.
    - `penetration`: m, largest penetration in the middle of a step, where the contact conditions
      are evaluated; zero if there was none.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> totals = cj.simulate_nonsmooth(scene, state, 0.02, step=1e-4).contacts["shoulder"]["V"]
    >>> bool(totals.impulse > 0.0)
    True
    """

    impacts: Integers = described("1")
    impulse: Numbers = described("N s")
    dissipated: Numbers = described("J")
    hardest: Numbers = described("N s")
    fastest: Numbers = described("m/s")
    penetration: Numbers = described("m")


class NonsmoothSolution(AbstractReadable, AbstractTabular):
    """Result of `clearjoint.simulate_nonsmooth`.

    - `time`, `final`, `result`: the end of the run, s, the `State` then, and the `RESULTS` code.
    - `formulation`: coordinates, stabilisation and linear solver; `redundant_constraints`: names of
      constraint equations that depend linearly on others.
    - `steps`: number of steps.
    - `saved`: the `Trajectory` at the N requested times; ``None`` if no times were requested.
    - `history[joint][contact]`: the `ContactTotals` from the start up to each of the N requested
      times; ``None`` if no times were requested.
    - `saved_count`: number of requested times that the run reached, or ``None``. In `saved` and
      `history`, the rows of times that the run did not reach repeat the last state.
    - `contacts[joint][contact]`: the `ContactTotals` of the whole run.
    - `residual`: largest violation of the contact conditions in any step that did not fail. After
      an impact, a contact opens at least with its restitution times the approach velocity; no
      impulse pulls; none acts at a contact that opens faster; and friction obeys Coulomb's law. The
      violation is divided by the largest velocity at closed contacts that the impulses, or the
      projection of the positions, have to change, or by 1e-9 m/s if that is larger.

    `observe` accepts a `NonsmoothSolution`, but the contact forces that it computes while a contact
    touches, and the accelerations and reactions that follow from them, are meaningless.

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

    @override
    def __repr__(self) -> str:
        if is_abstract(self):
            return super().__repr__()
        lines = [f"{self.steps} steps"]
        if self.saved is not None:
            lines.append(f"saved: {self.saved}")
        for joint, family in self.contacts.items():
            counts = (f"{totals.impacts} at {contact!r}" for contact, totals in family.items())
            lines.append(f"impacts of {joint!r}: {', '.join(counts)}")
        return run_text(self, self.final, self.redundant_constraints, lines)

    @override
    def to_xarray(self) -> "xr.Dataset":
        """Return the saved states and the history of contacts as an `xarray.Dataset`.

        States have the variables and units of `Trajectory.to_xarray`. The fields of `ContactTotals`
        are variables along "time" and "rigid_contact", with labels such as "pin V". Times that the
        run did not reach are left out. Attributes are result, time reached, s, and steps.

        **Raises:** `ValueError` if no states were saved.
        """
        remedy = "pass save=Saving(times) to simulate_nonsmooth()"
        require(self.saved is not None, "solution", "without saved states", "with some", remedy)
        assert self.saved is not None and self.history is not None and self.saved_count is not None
        dataset = self.saved.to_xarray()
        contacts = by_contact(self.history)
        if contacts:
            for f in fields(ContactTotals):
                values = np.stack([np.asarray(getattr(c, f.name)) for c in contacts.values()], 1)
                dataset[f.name] = ("time", RIGID), values, {"units": f.metadata["unit"]}
            dataset = dataset.assign_coords({RIGID: list(contacts)})
        notes = {
            "title": "motion of a mechanism with rigid contacts",
            "result": RESULTS[self.result],
            "time_reached": float(self.time),
            "steps": int(self.steps),
        }
        # Rows after the last reached time repeat the last state, and are left out.
        return dataset.isel(time=slice(int(self.saved_count))).assign_attrs(notes)
