"""Data that all lanes of a batch share, and data of each lane."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ...fields.types import Single
from ...math.vectors import ConstantFolded, Scalar, unpack
from ...model.bodies import State
from ...model.scene import Scene
from ...quantities.base import Quantity
from ..run.impact_recorder import ImpactRow
from ..run.recorders import RowBuffer
from ..step.dense_output import Snapshot
from ..step.types import Numbers
from .lane import Lane, Plan

Columns = dict[str, Scalar]
"""Reported columns of a log by name: numbers of one row, or arrays (R,) for R rows."""


class Task(eqx.Module):
    """Data of one lane.

    - `varied`: a tree like that of the scene, with the leaves that differ between lanes, and
      ``None`` instead of the other leaves.
    - `state`: the initial state, in packed form.
    - `end_time`, `first_step`: s, end of the run and length of its first step.
    - `save_at`: (K,) s, rising, times to save at, or ``None``.
    """

    varied: PyTree
    state: State
    end_time: Numbers
    first_step: Numbers
    save_at: jax.Array | np.ndarray | None


class Common(eqx.Module):
    """Data that all lanes of a batch share.

    - `plan`: method and outputs.
    - `folded_scene`: the base scene, some leaves of which each lane replaces.
    - `start_time`: s.
    - `capacity[log]`: largest number of rows of each log of crossings or impacts.
    - `channels[log][name]`: quantities to report for each recorded state.
    - `saved`: name of the log of saved states.
    - `tables[name]`: for each table of impacts, the logs of its contacts.
    - `programs`: digests of the traced programs, if known. A compiled program is reused only for
      equal digests, so that no program runs that was traced from code that has changed since.
    """

    plan: Plan
    folded_scene: ConstantFolded
    start_time: Single
    capacity: dict[str, int] = eqx.field(default_factory=dict, static=True)
    channels: dict[str, dict[str, Quantity]] = eqx.field(default_factory=dict)
    saved: str = eqx.field(default="", static=True)
    programs: tuple[tuple[str, str], ...] = eqx.field(default=(), static=True)
    tables: dict[str, tuple[str, ...]] = eqx.field(default_factory=dict, static=True)

    def logs(self, lane: Lane) -> dict[str, RowBuffer]:
        """Return the buffers of a lane by the name of the log that each fills."""
        saved = {} if lane.saved is None else {self.saved: lane.saved}
        return saved | lane.buffers()

    def scene(self, task: Task) -> Scene:
        """Return the scene of a lane, in scalar form, with the lane's own leaves."""
        tree = eqx.combine(task.varied, self.folded_scene.tree)
        return unpack(ConstantFolded(tree, self.folded_scene.patterns))

    def columns_of(
        self, name: str, example: Snapshot | ImpactRow, task: Task, rows: jax.Array
    ) -> Columns:
        """Return the columns that are reported of a log: by name, an array (R,) for R rows.

        **Arguments:**

        - `name`: name of the log.
        - `example`: a record of this log. Only its structure and shapes are used.
        - `task`: the lane that wrote the rows.
        - `rows`: (R, n) recorded rows; each is a record as a flat array of its n numbers.
        """
        leaves, structure = jax.tree.flatten(example)
        # Some columns are quantities, which are functions of the lane's scene too.
        system = self.plan.scheme.system(self.scene(task))
        channels = self.channels.get(name, {})
        # Each row has the numbers of the first leaf, then those of the second, and so on.
        boundaries = np.cumsum([leaf.size for leaf in leaves])[:-1]

        def columns_of_row(row: jax.Array) -> Columns:
            parts = zip(jnp.split(row, boundaries), leaves, strict=True)
            record: Snapshot | ImpactRow = jax.tree.unflatten(
                structure, [part.reshape(leaf.shape) for part, leaf in parts]
            )
            return record.columns(system, channels)

        return jax.lax.map(columns_of_row, rows)
