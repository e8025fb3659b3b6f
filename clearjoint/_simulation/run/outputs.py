"""The argument `outputs` of runs: named results, and their recorders. An output is a quantity,
evaluated at sample times, a reduction, a section, or a table of impacts or rejected steps."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import UnionType
from typing import TypeAlias

from ..._fields.checks import (
    errors_about,
    require,
    require_array_names,
    require_count,
    require_names,
)
from ..._model.scene import Scene
from ...quantities.base import Quantity, check_quantity, require_known
from ..reductions.base import AbstractReduction, Instants, Window, result_name
from ..results.impact_table import Impacts
from ..results.solution import TIME, Crossings
from .impact_recorder import ImpactRecorder, impact_rows_of
from .recorders import ReductionRecorder
from .rejections import RejectedSteps, Rejections, rejections_of
from .run_loop import Recorders, Records
from .saving import Saving, saving_or_nothing
from .sections import Section


@dataclass(frozen=True)
class ImpactTable:
    """Output with the first impacts of every contact, or of the contacts of one joint.

    In a `Solution` it is a table, `Impacts`. In a sweep, the output "hits" has the results
    ``hits_onset``, ``hits_separation``, ``hits_duration``, ``hits_entry_speed``,
    ``hits_exit_speed``, ``hits_peak_force``, ``hits_peak_time`` and ``hits_largest_penetration``,
    along the dimensions "hits_contact" and "hits_number", and ``hits_count`` along "hits_contact".
    For each contact, with a label such as "pin V", the table has the first `count` impacts: onset,
    separation, duration and peak time, s, entry and exit speed, m/s, peak force, N, and largest
    penetration, m. Rows after the recorded impacts are NaN. ``hits_count`` is the number of
    recorded impacts of each contact; a contact with `count` of them may have had more. A quantile
    of the peak forces is ``sweep.hits_peak_force.quantile(0.95, ["hits_contact", "hits_number"])``.

    **Arguments:**

    - `count`: largest number of impacts recorded for each contact.
    - `joint`: name of the joint whose contacts are recorded; by default all joints with contacts.
    - `after`, `until`: s, start and end of a time window; by default the whole run. An impact is
      recorded if its onset lies in the window. Each may be a function of the scene that returns a
      time and that JAX can trace, so that each run of a sweep has a window of its own.

    **Raises:** `ValueError` for a count that is not a positive integer, for times that are NaN or
    not single numbers, and for a window that does not end after its start.

    >>> scene, _ = cj.mechanisms.double_pendulum()
    >>> cj.ImpactTable(count=20, joint="shoulder").contacts(scene)
    [('shoulder', 'V'), ('shoulder', 'W')]
    """

    count: int
    joint: str | None = None
    after: Instants = None
    until: Instants = None

    def __post_init__(self) -> None:
        require_count("count", self.count, "pass a number of impacts")
        self.window()  # raises an error for wrong times

    def window(self) -> Window | None:
        window = Window(self.after, self.until)
        return None if self.after is None and self.until is None else window

    def check(self, scene: Scene) -> None:
        """Raise a `ValueError` if the scene has no contacts, or lacks the joint of the table."""
        joints = scene.contact_joints()
        if self.joint is not None:
            require_known("joint", self.joint, joints)
        require(len(joints) > 0, "scene", {}, "one with contacts", "leave the table out")

    def contacts(self, scene: Scene) -> list[tuple[str, str]]:
        laws = scene.laws()
        names = laws if self.joint is None else [self.joint]
        return [(name, label) for name in names for label in laws[name]]


Output: TypeAlias = Quantity | AbstractReduction | Section | ImpactTable | RejectedSteps
"""A named result of a run: a quantity, evaluated at sample times, a reduction such as `Peak`, a
`Section`, an `ImpactTable` or `RejectedSteps`.

>>> outputs = {"x": x, "speed": cj.Peak(cj.quantities.Velocity("ball"), "m/s")}
>>> save = cj.Saving([0.0, 0.1])  # the sample times
>>> solution = cj.simulate(scene, state, 0.1, save=save, outputs=outputs, progress=False)
>>> solution.outputs["x"].round(4), round(solution.outputs["speed"], 4)
(array([0.1   , 0.054 ]), 0.8415)
"""
RECORDED = AbstractReduction | Section | ImpactTable | RejectedSteps
"""Kinds of outputs that are recorded at steps, not evaluated at sample times."""
SECTIONS, REDUCTIONS, TABLES, REJECTIONS = "sections", "reductions", "tables", "rejections"
"""Keys of recorders and of records; under each of them is a dictionary by name of the output."""
Table: TypeAlias = Crossings | Impacts | Rejections
"""A result with a row for each event of a run."""
EXAMPLE = 'pass for example {"x": cj.quantities.Position("arm", "x")}'


@dataclass(frozen=True)
class Requested:
    """What a run is asked for besides its final state: `outputs` by name, and what `save` selects.
    It raises a `ValueError` unless `outputs` is a dictionary of `Output`s by name, and if a name is
    also that of a further result, as "peak_time" is beside a `Peak` with the name "peak"."""

    outputs: Mapping[str, Output]
    save: Saving

    def __post_init__(self) -> None:
        require_names("outputs", self.outputs, EXAMPLE)
        # NumPy's strings, which are equal to these, have other digests in the stores of sweeps.
        object.__setattr__(self, "outputs", {str(n): o for n, o in self.outputs.items()})
        expected = "a quantity, a reduction, a Section, an ImpactTable or RejectedSteps"
        for name, output in self.outputs.items():
            # A class, such as `Position` without arguments, is callable too, but no quantity.
            is_quantity = callable(output) and not isinstance(output, type)
            is_output = is_quantity or isinstance(output, RECORDED)
            require(is_output, f"outputs[{name!r}]", output, expected, EXAMPLE)
        # The result "" of a reduction has the name of the output itself.
        parts = {result_name(n, p) for n, o in self.reductions.items() for p in o.units() if p}
        twice = sorted(parts & set(self.outputs))
        require(not twice, "outputs", twice, "names of no part of a reduction", "rename the output")

    @cached_property
    def quantities(self) -> dict[str, Quantity]:
        return {n: output for n, output in self.outputs.items() if not isinstance(output, RECORDED)}

    @cached_property
    def reductions(self) -> dict[str, AbstractReduction]:
        return {n: o for n, o in self.outputs.items() if isinstance(o, AbstractReduction)}

    @cached_property
    def sections(self) -> dict[str, Section]:
        return {n: output for n, output in self.outputs.items() if isinstance(output, Section)}

    @cached_property
    def tables(self) -> dict[str, ImpactTable]:
        return {n: output for n, output in self.outputs.items() if isinstance(output, ImpactTable)}

    def check(self, scene: Scene, ledger: bool) -> None:
        """Check that a scene has the elements that the outputs name, and that no output needs the
        energy ledger if `ledger` is false; raise a `ValueError` that names the output."""
        for name, output in self.outputs.items():
            if isinstance(output, AbstractReduction):
                expected, remedy = f"True for outputs[{name!r}]", "pass Settings(ledger=True)"
                require(ledger or not output.needs_ledger, "ledger", ledger, expected, remedy)
            with errors_about(f"Output {name!r}"):
                if isinstance(output, RECORDED):
                    output.check(scene)
                else:
                    check_quantity("quantity", output, scene)

    def check_names(self) -> None:
        """Raise a `ValueError` for names that arrays in files cannot have, and for quantities
        without sample times."""
        require_array_names("outputs", self.outputs, EXAMPLE)
        remedy = "pass save=cj.Saving(times), or reduce the quantity by cj.Peak or cj.Statistics"
        for name in self.quantities:
            expected = f"those at which outputs[{name!r}] is evaluated"
            require(self.save.times is not None, "times", None, expected, remedy)

    def refuse(self, kinds: type | UnionType, expected: str, remedy: str) -> None:
        """Raise a `ValueError` if an output is of one of the types `kinds`, which the caller cannot
        compute. The message has the output's name, what is `expected`, and the `remedy`."""
        for name, output in self.outputs.items():
            is_possible = not isinstance(output, kinds)
            require(is_possible, f"outputs[{name!r}]", output, expected, remedy)

    def recorders(self) -> dict[str, Recorders]:
        tables, outputs = self.tables.items(), self.outputs.items()
        return {
            SECTIONS: {name: section.recorder for name, section in self.sections.items()},
            REDUCTIONS: {n: ReductionRecorder(o) for n, o in self.reductions.items()},
            TABLES: {n: ImpactRecorder(o.joint, o.window(), o.count) for n, o in tables},
            REJECTIONS: {n: o.recorder for n, o in outputs if isinstance(o, RejectedSteps)},
        }

    def recorded(self, records: Records, origin: float = 0.0) -> dict[str, Table]:
        """Return the tables in the records of a run, by name of the output. `origin`, s, is the
        scene's time from which the run counts its times."""
        found: dict[str, Table] = {}
        # Crossings are recorded with times of the scene, so the origin is not added to them.
        for name, section in self.sections.items():
            columns = records[SECTIONS][name].rows.filled()
            units = {key: unit for key, (_, unit) in section.pairs.items()}
            found[name] = Crossings(columns.pop(TIME), columns, units)
        for name, record in records[TABLES].items():
            found[name] = Impacts.of_rows(impact_rows_of(record, origin))
        for name, record in records[REJECTIONS].items():
            found[name] = rejections_of(record, origin)
        return found


def requested_by(outputs: Mapping[str, Output] | None, save: Saving | None) -> Requested:
    return Requested({} if outputs is None else outputs, saving_or_nothing(save))
