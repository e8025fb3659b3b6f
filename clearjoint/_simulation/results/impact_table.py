"""Table of the impacts of a run, and its check against the ranges of contact laws."""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np
from typing_extensions import override

from ..._export.datasets import AbstractTabular, Labelled, labelled_dataset, texts
from ..._fields.checks import require_type
from ..._fields.objects import described
from ..._model.contact.laws import exceeded
from ..._model.scene import Scene, require_scene

if TYPE_CHECKING:
    import xarray as xr

NAMED = "joint", "contact"
"""Columns of `Impacts` that contain names instead of numbers."""


@dataclass(frozen=True)
class Impacts(AbstractTabular):
    """Table of the N contacts that began and ended during a run, in the order of their onsets.

    Contacts that touch at the start or the end of the run are left out. Fields are arrays, (N,).

    - `joint`, `contact`: name of the joint and label of the contact, such as "V".
    - `onset`, `separation`: s, times at which the contact force began and ended.
    - `duration`: s, from onset to separation.
    - `entry_speed`, `exit_speed`: m/s, positive speeds of approach at the onset, and of separation.
    - `peak_force`, `peak_time`: largest normal force in N, and its time in s.
    - `largest_penetration`: m.

    `simulate(scene, state, end_time, save=Saving(impacts=True)).impacts` is such a table. A table
    can also be built from its columns:

    >>> columns = [np.array([name]) for name in ("pin", "V")]
    >>> numbers = 0.01, 0.0102, 0.0002, 0.1, 0.08, 900.0, 0.0101, 2e-6  # in the order above
    >>> columns += [np.array([number]) for number in numbers]
    >>> impacts = cj.results.Impacts(*columns)
    >>> print(f"{impacts.exit_speed[0] / impacts.entry_speed[0]:.2f}")  # the restitution
    0.80
    """

    joint: np.ndarray
    contact: np.ndarray
    onset: np.ndarray = described("s")
    separation: np.ndarray = described("s")
    duration: np.ndarray = described("s")
    entry_speed: np.ndarray = described("m/s")
    exit_speed: np.ndarray = described("m/s")
    peak_force: np.ndarray = described("N")
    peak_time: np.ndarray = described("s")
    largest_penetration: np.ndarray = described("m")

    def __len__(self) -> int:
        return len(self.onset)

    @override
    def to_xarray(self) -> "xr.Dataset":
        """Return the columns as variables of an `xarray.Dataset` along "impact"."""
        names = {name: Labelled(("impact",), texts(getattr(self, name))) for name in NAMED}
        numbers = {
            name: Labelled(("impact",), getattr(self, name), unit, name.replace("_", " "))
            for name, unit in IMPACT_UNITS.items()
        }
        order = Labelled(("impact",), np.arange(len(self), dtype=np.int32))
        return labelled_dataset("impacts", {**names, **numbers}, {"impact": order})

    @staticmethod
    def of_rows(rows: Iterable[tuple[str | float, ...]]) -> "Impacts":
        """Return the table made of `rows`, in any order: tuples of the values of all fields."""
        names = [f.name for f in fields(Impacts)]
        # Without rows, `zip` gives no columns; a table without impacts has empty ones.
        columns = list(zip(*rows, strict=True)) or [()] * len(names)
        dtypes = [object if name in NAMED else float for name in names]
        table = Impacts(*map(np.array, columns, dtypes))
        # Impacts are ordered by their onset, and impacts with equal onsets by joint and contact:
        # `lexsort` takes the most important key last.
        keys = table.contact.astype(str), table.joint.astype(str), table.onset
        return table._rows(np.lexsort(keys))

    def of(self, joint: str, contact: str) -> "Impacts":
        """Return the table of the impacts of one contact, such as "V"; empty for unknown names."""
        return self._rows((self.joint == joint) & (self.contact == contact))

    def within(self, after: float = -np.inf, until: float = np.inf) -> "Impacts":
        """Return the table of those impacts whose onset t, s, satisfies `after` <= t < `until`.

        For example, ``np.quantile(solution.impacts.within(after=0.5).peak_force, 0.95)``.
        """
        return self._rows((self.onset >= after) & (self.onset < until))

    def _rows(self, chosen: np.ndarray) -> "Impacts":
        return Impacts(**{f.name: getattr(self, f.name)[chosen] for f in fields(self)})


IMPACT_UNITS = {f.name: f.metadata["unit"] for f in fields(Impacts) if f.metadata}
"""Unit of each column of `Impacts` that contains numbers."""


def beyond_law_ranges(scene: Scene, impacts: Impacts) -> list[str]:
    """Report contacts that were deeper than the range of validity of their contact law, beyond
    which its forces are not reliable.

    **Returns:** one sentence for each exceeded limit, with the joint, the contact, the law, the
    limit and the largest penetration; an empty list if there is none.

    >>> cylinder = cj.laws.JohnsonCylinder(207e9, 0.3, length=10e-3)
    >>> scene, _ = cj.mechanisms.double_pendulum(law=cj.laws.Hertz(cylinder))
    >>> depth = 0.4e-3  # m, of 0.5 mm of clearance
    >>> row = ("shoulder", "V", 0.01, 0.0102, 0.0002, 0.1, 0.08, 900.0, 0.0101, depth)
    >>> impacts = cj.results.Impacts.of_rows([row])
    >>> print(cj.beyond_law_ranges(scene, impacts)[0][:66])
    Contact 'V' of joint 'shoulder': `JohnsonCylinder` holds for a pen
    """
    require_scene(scene)
    remedy = "pass solution.impacts of a run with save=Saving(impacts=True)"
    require_type("impacts", impacts, Impacts, "a table of impacts", remedy)
    sentences = []
    for name, joint in scene.contact_joints().items():
        for label in joint.laws():
            depths = impacts.of(name, label).largest_penetration
            if len(depths):
                limits = joint.law_limits(label, float(depths.max()))
                where = f"Contact {label!r} of joint {name!r}: "
                sentences += [where + text for text in exceeded(limits, "penetration")]
    return sentences
