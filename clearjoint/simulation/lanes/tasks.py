"""Data of a batch of lanes: those that all lanes share, and those of each lane.

A lane is one run of a sweep. A log is a table that a lane writes: the crossings of a section, the
impacts of a contact, or the saved states.
"""

import equinox as eqx
import jax
import numpy as np
from jaxtyping import PyTree

from ...fields.types import Single
from ...math.vectors import ConstantFolded, unpack
from ...model.bodies import State
from ...model.scene import Scene
from ...quantities.base import Quantity
from ..run.recorders import RowBuffer
from ..step.types import Numbers
from .lane import Lane, Plan


class Task(eqx.Module):
    """Data of one lane; in a batch of L lanes, each array has an additional first axis of length L.

    - `varied`: a PyTree with the structure of the scene, with those leaves that differ between
      lanes, and ``None`` in place of the others.
    - `state`: the initial state, in packed form (vectors as arrays (3,)).
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

    - `plan`: integration method and outputs.
    - `folded_scene`: the scene, of which each lane replaces the leaves in `Task.varied`. Components
      that are exactly 0 or 1 in all lanes are marked as constants.
    - `start_time`: s, start of all runs.
    - `capacity[log]`: largest number of rows of each log of crossings or impacts.
    - `channels[log][name]`: quantities whose values are reported for each recorded state of a log.
    - `saved`: name of the log of saved states.
    - `tables[name]`: for each table of impacts, the names of the logs of its contacts.
    - `programs`: pairs of name and digest of the traced programs; empty if unknown. A compiled
      program is reused only for equal digests, so that no program runs that was traced from code
      that has changed since.
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
        """Return the buffers of a lane, by the name of the log whose rows they hold."""
        saved = {} if lane.saved is None else {self.saved: lane.saved}
        return saved | lane.buffers()

    def scene(self, task: Task) -> Scene:
        """Return the scene of a lane, with its own leaves. Each vector is three separate
        scalars."""
        tree = eqx.combine(task.varied, self.folded_scene.tree)
        return unpack(ConstantFolded(tree, self.folded_scene.patterns))
