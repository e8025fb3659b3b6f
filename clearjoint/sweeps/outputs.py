"""Outputs of a sweep beside reductions: quantities at chosen times, Poincaré sections, impacts."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..fields.checks import as_number, require, require_count
from ..model.scene import Scene
from ..quantities.base import Quantity, check_quantity, require_known
from ..simulation.batch.recording import Crossing
from ..simulation.batch.reductions import AbstractReduction
from .layout import check_array_names

Channels = Mapping[str, tuple[Quantity, str]]
"""Quantities with their units, by name."""
PASS_CHANNELS = 'pass for example {"x": (Position("slider", "x"), "m")}'


@dataclass(frozen=True)
class Saved:
    """Quantities at chosen times, by the solver's dense output.

    **Arguments:**

    - `times`: (K,) s, rising; or a function of the lane's scene that returns as many for every
      lane, such as one instant in each turn of a crank whose speed is swept.
    - `channels`: quantity and unit by name.
    """

    times: ArrayLike | Callable[[Scene], ArrayLike]
    channels: Channels

    def __post_init__(self) -> None:
        _check_channels(self.channels)

    def check(self, scene: Scene) -> None:
        """Check that a scene has what the channels name."""
        _check_quantities(self.channels, scene)

    def at(self, scene: Scene) -> np.ndarray:
        """The times of a lane, (K,) s."""
        chosen = np.asarray(self.times(scene) if callable(self.times) else self.times)
        times = chosen if chosen.dtype.kind == "f" else np.asarray(as_number(chosen))
        fine = times.ndim == 1 and times.size > 0 and bool(np.isfinite(times).all())
        require(
            fine and bool((np.diff(times) >= 0).all()),
            "times",
            times,
            "a rising row of finite times",
            "sort the times",
        )
        return times


@dataclass(frozen=True)
class Section:
    """A Poincaré section: quantities where another one passes zero, rising.

    **Arguments:**

    - `crossing`: the quantity that passes zero.
    - `channels`: quantity and unit by name, taken there.
    - `count`: how many crossings are kept, the first ones.
    - `after`: s; earlier crossings, of the transient, are left out.
    """

    crossing: Quantity
    channels: Channels
    count: int
    after: float = 0.0
    condition: Crossing = field(init=False)

    def __post_init__(self) -> None:
        _check_channels(self.channels)
        require_count("count", self.count, "pass a number of crossings")
        object.__setattr__(self, "condition", Crossing(self.crossing, self.after))

    def check(self, scene: Scene) -> None:
        """Check that a scene has what the crossing and the channels name."""
        check_quantity("crossing", self.crossing, scene)
        _check_quantities(self.channels, scene)


@dataclass(frozen=True)
class ImpactTable:
    """The finished contacts of a lane, as `simulate(..., record_impacts=True)` tables them.

    For each contact, by the label "joint contact", its first `count` impacts with their onset,
    separation, duration and peak time, s, entry and exit speed, m/s, peak force, N, and largest
    penetration, m; and how many were recorded. A contact that has recorded `count` of them may
    have had more.

    **Arguments:** `count`: impacts kept of each contact; `joint`: name of the joint whose contacts
    are tabled, of all joints unless given.
    """

    count: int
    joint: str | None = None

    def __post_init__(self) -> None:
        require_count("count", self.count, "pass a number of impacts")

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


Output = AbstractReduction | Saved | Section | ImpactTable


def check_outputs(outputs: Mapping[str, Output], scene: Scene, ledger: bool) -> None:
    """Check that outputs can be kept, and that the scene has what they name.

    **Raises:** `ValueError` that names the output.
    """
    check_array_names("outputs", outputs, 'pass for example {"hits": cj.ImpactCount("pin")}')
    for name, output in outputs.items():
        require(
            isinstance(output, Output),
            f"outputs[{name!r}]",
            output,
            "a reduction, a Saved, a Section or an ImpactTable",
            "subclass AbstractReduction, or pass one of clearjoint's",
        )
        needs = isinstance(output, AbstractReduction) and output.needs_ledger
        require(
            ledger or not needs,
            "ledger",
            ledger,
            f"True for outputs[{name!r}]",
            "pass Settings(ledger=True)",
        )
        try:
            output.check(scene)
        except ValueError as error:
            raise ValueError(f"Output {name!r}: {error}") from error
    saves = [name for name, output in outputs.items() if isinstance(output, Saved)]
    require(len(saves) <= 1, "outputs", saves, "with one Saved at most", "join their times")


def _check_channels(channels: Channels) -> None:
    check_array_names("channels", channels, PASS_CHANNELS)
    fine = bool(channels) and all(
        isinstance(pair, tuple)
        and len(pair) == 2
        and callable(pair[0])
        and isinstance(pair[1], str)
        for pair in channels.values()
    )
    require(
        fine,
        "channels",
        channels,
        "a (quantity, unit) pair by name",
        PASS_CHANNELS,
    )
    taken = sorted({"time", "count"} & set(channels))
    require(not taken, "channels", taken, "of names that the output does not use", "rename them")


def _check_quantities(channels: Channels, scene: Scene) -> None:
    for name, (quantity, _) in channels.items():
        check_quantity(f"channel {name!r}", quantity, scene)
