"""Outputs of a sweep: quantities and states at given times, and tables of impacts. Functions of
this module also check all outputs of a sweep before it runs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..fields.checks import errors_about, require, require_array_names, require_count
from ..fields.types import ArrayLike
from ..math.vectors import pack
from ..model.scene import Scene
from ..quantities.base import require_known
from ..quantities.instant import Instant
from ..simulation.reductions.base import AbstractReduction, Instants, Window, check_reductions
from ..simulation.results.state_tables import STATE_PARTS
from ..simulation.run.saving import Saving
from ..simulation.run.sections import Channels, Section, check_channels, check_quantities
from ..simulation.step.spans import check_strictly_rising

SAVED = "saved"
"""Prefix of the variables with saved states, such as "saved_position", the positions of all
bodies."""
PASS_TABLE = 'pass outputs={"hits": cj.ImpactTable(20)}, which keeps the first 20 of each contact'


@dataclass(frozen=True)
class Saved:
    """Quantities at given times, computed with the solver's dense output.

    **Arguments:**

    - `times`: (K,) s, strictly rising; or a function of the lane's scene that returns K times for
      every lane, such as one time in each revolution of a crank whose speed is swept. They are
      checked when the sweep begins.
    - `channels`: the quantities to record: pairs (quantity, unit as text) by name.

    **Raises:** `ValueError` if there are no channels, or if they are not such pairs; and for names
    of channels that no array can have, "time" and "count".

    >>> offset = cj.quantities.JournalOffset("shoulder", "x")
    >>> saved = cj.Saved(np.linspace(0.0, 0.1, 5), {"x": (offset, "m")})
    >>> saved.times.shape
    (5,)
    """

    times: ArrayLike | Callable[[Scene], ArrayLike]
    channels: Channels

    def __post_init__(self) -> None:
        check_channels(self.channels)

    def check(self, scene: Scene) -> None:
        """Check that the scene has the bodies and joints that the channels name.

        **Raises:** `ValueError` for a name that the scene lacks.
        """
        check_quantities(self.channels, scene)

    def at(self, scene: Scene) -> np.ndarray:
        """Return the times at which the quantities are recorded in a lane, (K,) s.

        **Arguments:** `scene`: scene of the lane.

        **Raises:** `ValueError` for times that are not a row of finite numbers, or that don't rise
        strictly.
        """
        chosen = np.asarray(self.times(scene) if callable(self.times) else self.times)
        times = np.asarray(check_strictly_rising(chosen, "times"))
        # Single precision is kept, because later checks allow for its rounding errors.
        return chosen if chosen.dtype.kind == "f" else times


@dataclass(frozen=True)
class ImpactTable:
    """Table of the finished impacts of a lane, with the columns of `simulate`'s table.

    For each contact, labelled by joint and contact such as "pin V", the table has the first `count`
    impacts: onset, separation, duration and peak time, s, entry and exit speed, m/s, peak force, N,
    and largest penetration, m. Rows behind the recorded impacts are NaN. The table also has the
    number of recorded impacts of each contact; a contact with `count` of them may have had more.

    Quantiles of the recorded impacts are exact:

    ```python
    import clearjoint as cj

    outputs = {"hits": cj.ImpactTable(200, "shoulder", after=0.5)}
    # sweep = cj.sweep(..., outputs=outputs)
    # sweep.hits_peak_force.quantile(0.95, ["hits_contact", "hits_number"])
    ```

    **Arguments:**

    - `count`: number of impacts kept for each contact.
    - `joint`: name of the joint whose contacts are recorded; by default all joints.
    - `after`, `until`: s, the window of time of the onsets; by default the whole run.

    **Raises:** `ValueError` for a count that is not a positive integer, and for a window that does
    not end after its start.

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
        self.window()

    def window(self) -> Window | None:
        """Return the time window in which impacts must begin; ``None`` for the whole run."""
        window = Window(self.after, self.until)
        return None if window.is_whole else window

    def check(self, scene: Scene) -> None:
        """Check that the scene has joints with contacts, among them the joint of the table.

        **Raises:** `ValueError` otherwise.
        """
        known = scene.contact_joints()
        if self.joint is not None:
            require_known("joint", self.joint, known)
        require(len(known) > 0, "scene", {}, "one with contacts", "leave the table out")

    def contacts(self, scene: Scene) -> list[tuple[str, str]]:
        """Return the table's contacts as pairs of joint and label, such as ("shoulder", "V")."""
        laws = scene.laws()
        names = laws if self.joint is None else [self.joint]
        return [(name, label) for name in names for label in laws[name]]


class PartOfStates(eqx.Module):
    """Quantity whose value is one part of the states of all bodies, such as all positions.

    - `part`: "position", "orientation", "velocity" or "spin", in the unit given by `STATE_PARTS`.
    - `bodies`: names of the bodies, in the order of the rows.
    """

    part: str = eqx.field(static=True)
    bodies: tuple[str, ...] = eqx.field(static=True)

    def __call__(self, now: Instant) -> Float[Array, "bodies parts"]:
        """Return the part at an instant, (bodies, components of the part)."""
        return jnp.stack([pack(getattr(now.bodies[name], self.part)) for name in self.bodies])


class StatesOfLanes:
    """Output with the states of all bodies of a scene at given times. A sweep has it if
    `Saving.times` is given.

    **Arguments:** `times`: (K,) s, the same in all lanes; `scene`: scene with these bodies.
    """

    def __init__(self, times: Float[np.ndarray, " K"], scene: Scene):
        self.times, bodies = times, tuple(scene.bodies)
        self.channels = {
            part: (PartOfStates(part, bodies), unit) for part, (_, unit) in STATE_PARTS.items()
        }

    def check(self, scene: Scene) -> None:
        """Accept every scene, because every scene has bodies."""

    def at(self, scene: Scene) -> np.ndarray:
        """Return the times (K,) s, which don't depend on the scene."""
        del scene
        return self.times


AnySaved = Saved | StatesOfLanes
"""Outputs at given times: `channels` are pairs (quantity, unit) by name, `at` returns the times."""
Output = AbstractReduction | AnySaved | Section | ImpactTable


def with_saving(outputs: Mapping[str, Output], save: Saving, scene: Scene) -> dict[str, Output]:
    """Return all outputs of a sweep by name: `outputs` and those for which `save` asks.

    Sections and outputs of `save` keep their names. If `save` has times, there is an output `SAVED`
    with the states of all bodies at these times.

    **Raises:** `ValueError` for a `save` with steps or impacts, which sweeps don't support, for
    names of outputs that no array can have, and for a name in both `outputs` and `save`.
    """
    require_array_names("outputs", outputs, 'pass for example {"hits": cj.ImpactCount("pin")}')
    save.require_none(["steps"], "in a sweep", "pass the lane's scene to simulate() for them")
    require(not save.impacts, "impacts", True, "False in a sweep", PASS_TABLE)
    further: dict[str, Output] = {**save.sections, **save.outputs}
    if save.times is not None:
        further[SAVED] = StatesOfLanes(np.asarray(save.times, dtype=float), scene)
    twice = sorted(set(outputs) & set(further))
    require(not twice, "outputs", twice, "names that `save` does not use", "rename the output")
    return {**outputs, **further}


def check_outputs(outputs: Mapping[str, Output], scene: Scene, ledger: bool) -> None:
    """Check that a sweep supports the outputs, and that the scene has the elements they name.

    **Arguments:** `outputs`: outputs by name; `scene`: scene of the sweep; `ledger`: whether the
    energy ledger is computed (`Settings.ledger`), which some reductions need.

    **Raises:** `ValueError` that names the output; also for more than one `Saved`.
    """
    for name, output in outputs.items():
        expected = "a reduction, a Saved, a Section or an ImpactTable"
        remedy = "subclass AbstractReduction, or pass one of clearjoint's"
        require(isinstance(output, Output), f"outputs[{name!r}]", output, expected, remedy)
        check_reductions({name: output}, scene, ledger)
        if not isinstance(output, AbstractReduction):
            # The message of the error gets the name of the output, as for reductions.
            with errors_about(f"Output {name!r}"):
                output.check(scene)
    # A lane has one list of times to save at.
    saves = [name for name, output in outputs.items() if isinstance(output, AnySaved)]
    remedy = "join their times"
    require(len(saves) <= 1, "outputs", saves, "outputs with at most one Saved", remedy)
