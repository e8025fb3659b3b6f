"""Output with the rejected steps of a run, and the reason why each was rejected."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from typing_extensions import override

from ..._export.datasets import AbstractTabular, Labelled, labelled_dataset, texts
from ..._fields.checks import require_count, require_shape
from ..._fields.objects import on_device
from ..._math.vectors import Scalar
from ..._model.scene import Scene
from ..step.step_state import Rejection
from .recorders import RowBuffer
from .run_loop import AbstractRecorder, RunStart, StepOutcome

if TYPE_CHECKING:
    import xarray as xr

REASONS = tuple(Rejection)
"""The reasons, in the order of the numbers that stand for them in compiled code."""


@dataclass(frozen=True)
class Rejections(AbstractTabular):
    """Table of the N rejected steps of a run that a `RejectedSteps` keeps, in their order.

    - `start`: (N,) s, start of the step. Successive rows with equal starts are trials of one step.
    - `length`: (N,) s, length of the step that was tried.
    - `reason`: (N,), the text of a `Rejection`.
    - `counts`: number of rejected steps by reason, including those for which there is no room.

    >>> table = cj.results.Rejections(
    ...     np.array([0.1]), np.array([1e-3]), np.array(["rotation"]), {"rotation": 1}
    ... )
    >>> print(table)
    rejected steps: 1 rotation
    """

    start: np.ndarray
    length: np.ndarray
    reason: np.ndarray
    counts: Mapping[str, int]

    def __len__(self) -> int:
        return len(self.start)

    @override
    def __str__(self) -> str:
        parts = ", ".join(f"{count} {reason}" for reason, count in self.counts.items() if count)
        return f"rejected steps: {parts or 'none'}"

    @override
    def to_xarray(self) -> "xr.Dataset":
        """Return an `xarray.Dataset` of the columns along "rejection"; `counts` are attributes."""
        dims = ("rejection",)
        columns = {
            "start": Labelled(dims, self.start, "s", "start of the step"),
            "length": Labelled(dims, self.length, "s", "length that was tried"),
            "reason": Labelled(dims, texts(self.reason)),
        }
        order = {"rejection": Labelled(dims, np.arange(len(self), dtype=np.int32))}
        counts = tuple((f"rejected by {reason}", count) for reason, count in self.counts.items())
        return labelled_dataset("rejected steps", columns, order, counts)


class RejectedRow(NamedTuple):
    """A rejected step: its start, s since `System.origin`, the length that was tried, s, and the
    index of the reason in `REASONS`."""

    start: Scalar
    length: Scalar
    reason: Scalar


class RejectionRecord(NamedTuple):
    rows: RowBuffer[RejectedRow]
    counts: dict[str, jax.Array]


class RejectionRecorder(AbstractRecorder[RejectionRecord]):
    """Recorder of rejected steps. Unlike other records, its record changes at rejected attempts.

    - `earliest`: s, time of the scene before which rejected steps are ignored.
    - `capacity`: number of rows in the buffer. Further steps are only counted.
    """

    earliest: Scalar
    capacity: int = eqx.field(static=True)

    @override
    def start(self, start: RunStart) -> RejectionRecord:
        blank = RejectedRow(*(jnp.zeros(()) for _ in RejectedRow._fields))
        counts: dict[str, jax.Array] = dict.fromkeys(REASONS, jnp.zeros((), int))
        return RejectionRecord(RowBuffer.like(blank, self.capacity), counts)

    @override
    def after(self, record: RejectionRecord, step_outcome: StepOutcome) -> RejectionRecord:
        rejected, t = step_outcome.tried.rejected, step_outcome.before.t
        assert rejected is not None, "only in a record of accepted attempts"
        is_late = step_outcome.system.scene_time(t) >= self.earliest
        reasons = {reason: is_late & is_true for reason, is_true in rejected.reasons.items()}
        # At most one reason is true (see `decide_step`), so that the sum is its index.
        number = sum(REASONS.index(reason) * is_true for reason, is_true in reasons.items())
        row = RejectedRow(t, rejected.t1 - t, jnp.asarray(number, float))
        # Reasons that cannot occur in the run are missing in `reasons`.
        counts = {n: count + reasons.get(n, 0) for n, count in record.counts.items()}
        is_rejected = sum(counts.values()) > sum(record.counts.values())
        return RejectionRecord(record.rows.with_row(row, is_rejected), counts)


@dataclass(frozen=True)
class RejectedSteps:
    """Output with the steps that were tried and rejected in a run, and the reason of each: a
    `Rejections`. It shows why a run takes many steps, or where and why the run gets stuck. Sweeps
    lack this output: pass the scene of one run of the sweep to `simulate`.

    The possible reasons are the values of `results.Rejection`. Steps that end early because the
    solver expects an event there, such as an onset or a breakpoint, are not rejected.

    **Arguments:**

    - `count`: largest number of rejected steps in the table; later ones are only counted.
    - `after`: s, time of the scene before which rejected steps are ignored; by default none are.
      For the last rejected steps of a failed run, pass a time shortly before its `Solution.time`.

    **Raises:** `ValueError` for a `count` that is no positive integer or an infinite `after`.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> outputs = {"rejected": cj.RejectedSteps()}
    >>> solution = cj.simulate(scene, state, 0.05, outputs=outputs, progress=False)
    >>> table = solution.outputs["rejected"]
    >>> print(table.reason[0], len(table) == solution.attempts - solution.accepted)
    error estimate True
    """

    count: int = 1000
    after: Annotated[float | None, "s"] = None

    def __post_init__(self) -> None:
        require_count("count", self.count, "pass a number of rejected steps")
        if self.after is not None:
            require_shape("after", self.after, (), "pass one time in s")

    @property
    def recorder(self) -> RejectionRecorder:
        earliest = on_device(-math.inf if self.after is None else self.after)
        return RejectionRecorder(earliest, self.count)

    def check(self, scene: Scene) -> None:
        """Do nothing, because all scenes have steps."""


def rejections_of(record: RejectionRecord, origin: float = 0.0) -> Rejections:
    """Return the table of a record. `origin`: `System.origin`, s, which is added to the starts."""
    start, length, numbers = (np.asarray(column) for column in record.rows.filled())
    reasons = np.array([REASONS[int(k)].value for k in numbers], dtype=object)
    counts = {reason.value: int(record.counts[reason]) for reason in REASONS}
    return Rejections(start + origin, length, reasons, counts)
