"""What a `Saving` keeps of a sweep's lanes, as outputs."""

from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..fields.checks import require, require_array_names
from ..math.vectors import pack
from ..model.scene import Scene
from ..quantities.instant import Instant
from ..simulation.results.state_tables import STATE_PARTS
from ..simulation.run.saving import Saving
from .outputs import AbstractSaved, Output

SAVED = "saved"
"""Name of the output that holds states: "saved_position" is the position of all bodies."""
PASS_TABLE = 'pass outputs={"hits": cj.ImpactTable(20)}, which keeps the first 20 of each contact'


class PartOfStates(eqx.Module):
    """A part of the states of all bodies, such as "velocity", body after body."""

    part: str = eqx.field(static=True)
    bodies: tuple[str, ...] = eqx.field(static=True)

    def __call__(self, now: Instant) -> Float[Array, "bodies parts"]:
        """The part at an instant, in the unit that `STATE_PARTS` says."""
        return jnp.stack([pack(getattr(now.bodies[name], self.part)) for name in self.bodies])


class StatesOfLanes(AbstractSaved):
    """The states of all bodies at times (K,) s, the same in all lanes."""

    def __init__(self, times: Float[np.ndarray, " K"], scene: Scene):
        self.times, bodies = times, tuple(scene.bodies)
        self.channels = {
            part: (PartOfStates(part, bodies), unit) for part, (_, unit) in STATE_PARTS.items()
        }

    def check(self, scene: Scene) -> None:
        """Every scene has bodies."""

    def at(self, scene: Scene) -> np.ndarray:
        """The times of a lane, (K,) s."""
        del scene
        return self.times


def outputs_beside(outputs: Mapping[str, Output], save: Saving, scene: Scene) -> dict[str, Output]:
    """The outputs, and those that hold what is to be saved.

    **Raises:** `ValueError` for what lanes can't save, and for names that stand for two things.
    """
    require_array_names("outputs", outputs, 'pass for example {"hits": cj.ImpactCount("pin")}')
    save.require_no_steps("in a sweep", "pass the lane's scene to simulate() for them")
    require(not save.impacts, "impacts", True, "False in a sweep", PASS_TABLE)
    further: dict[str, Output] = {**save.sections, **save.outputs}
    if save.times is not None:
        further[SAVED] = StatesOfLanes(np.asarray(save.times, dtype=float), scene)
    twice = sorted(set(outputs) & set(further))
    require(not twice, "outputs", twice, "of names that `save` does not use", "rename the output")
    return {**outputs, **further}
