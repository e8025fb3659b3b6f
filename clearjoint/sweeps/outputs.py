"""Outputs of a sweep beside reductions: quantities at chosen times, Poincaré sections, impacts."""

import abc
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ..fields.checks import as_number, require, require_count
from ..fields.types import ArrayLike
from ..model.scene import Scene
from ..quantities.base import require_known
from ..simulation.reductions.reductions import AbstractReduction, check_reductions
from ..simulation.reductions.windows import Instants, Window
from ..simulation.results.channels import Channels, check_channels, check_quantities
from ..simulation.run.sections import Section


class AbstractSaved(abc.ABC):
    """Something at chosen times: `channels` there, quantity and unit by name."""

    channels: Channels

    @abc.abstractmethod
    def check(self, scene: Scene) -> None:
        """Check that a scene has what the channels name."""

    @abc.abstractmethod
    def at(self, scene: Scene) -> np.ndarray:
        """The times of a lane, (K,) s."""


@dataclass(frozen=True)
class Saved(AbstractSaved):
    """Quantities at chosen times, by the solver's dense output.

    **Arguments:**

    - `times`: (K,) s, rising; or a function of the lane's scene that returns as many for every
      lane, such as one instant in each turn of a crank whose speed is swept.
    - `channels`: quantity and unit by name.

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
        """Check that a scene has what the channels name."""
        check_quantities(self.channels, scene)

    def at(self, scene: Scene) -> np.ndarray:
        """The times of a lane, (K,) s."""
        chosen = np.asarray(self.times(scene) if callable(self.times) else self.times)
        times = chosen if chosen.dtype.kind == "f" else np.asarray(as_number(chosen, "times", "s"))
        fine = times.ndim == 1 and times.size > 0 and bool(np.isfinite(times).all())
        require(
            fine and bool((np.diff(times) > 0).all()),
            "times",
            times,
            "a rising row of finite times, none of them twice",
            "sort the times, by numpy.unique say",
        )
        return times


@dataclass(frozen=True)
class ImpactTable:
    """The finished contacts of a lane, as `simulate` tables them.

    For each contact, by the label "joint contact", its first `count` impacts with their onset,
    separation, duration and peak time, s, entry and exit speed, m/s, peak force, N, and largest
    penetration, m; and how many were recorded. A contact that has recorded `count` of them may
    have had more.

    Their quantiles are exact, of those that are kept:

    ```python
    import clearjoint as cj

    outputs = {"hits": cj.ImpactTable(200, "shoulder", after=0.5)}
    # sweep = cj.sweep(..., outputs=outputs)
    # sweep.hits_peak_force.quantile(0.95, ["hits_contact", "hits_number"])
    ```

    **Arguments:**

    - `count`: impacts kept of each contact.
    - `joint`: name of the joint whose contacts are tabled, of all joints unless given.
    - `after`, `until`: s, the window of time in which they began; from the start to the end of the
      run unless given.

    **Raises:** `ValueError` for a count that is none, and a window that does not end after its
    begin.

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
        """The part of the run in which impacts begin; ``None`` for the whole run."""
        window = Window(self.after, self.until)
        return None if window.is_whole else window

    def check(self, scene: Scene) -> None:
        """Check that a scene has the joint, and contacts."""
        known = scene.contact_joints()
        if self.joint is not None:
            require_known("joint", self.joint, known)
        require(len(known) > 0, "scene", {}, "one with contacts", "leave the table out")

    def contacts(self, scene: Scene) -> list[tuple[str, str]]:
        """Joint and label of each contact that is tabled."""
        laws = scene.laws()
        names = laws if self.joint is None else [self.joint]
        return [(name, label) for name in names for label in laws[name]]


Output = AbstractReduction | AbstractSaved | Section | ImpactTable


def check_outputs(outputs: Mapping[str, Output], scene: Scene, ledger: bool) -> None:
    """Check that outputs can be kept, and that the scene has what they name.

    **Raises:** `ValueError` that names the output.
    """
    for name, output in outputs.items():
        require(
            isinstance(output, Output),
            f"outputs[{name!r}]",
            output,
            "a reduction, a Saved, a Section or an ImpactTable",
            "subclass AbstractReduction, or pass one of clearjoint's",
        )
        check_reductions({name: output}, scene, ledger)
        if isinstance(output, AbstractReduction):
            continue
        try:
            output.check(scene)
        except ValueError as error:
            raise ValueError(f"Output {name!r}: {error}") from error
    saves = [name for name, output in outputs.items() if isinstance(output, AbstractSaved)]
    require(len(saves) <= 1, "outputs", saves, "with one Saved at most", "join their times")
