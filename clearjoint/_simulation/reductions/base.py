"""Base classes of reductions: outputs of a run that are updated at every accepted step. A reduction
carries a tally, a PyTree of arrays of fixed shape, from step to step: memory does not grow."""

import abc
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, TypeAlias

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree
from typing_extensions import override

from ..._fields.checks import as_number, require
from ..._fields.objects import AbstractConverting
from ..._math.vectors import Condition, Scalar
from ..._model.scene import Scene
from ...quantities.base import Instant, Quantity, check_quantity, real_number

Times: TypeAlias = tuple[float, ...]
Instants: TypeAlias = Annotated[float | Callable[[Scene], Scalar] | None, "s"]
"""A time in s, a function of the scene that returns one, or ``None`` for the run's start or end."""


class AbstractReduction(AbstractConverting):
    """Base class of outputs that are updated at every accepted step of a run.

    A subclass defines `start`, `update`, `results` and `units`; the first three are traced by JAX.
    A tally, a PyTree of numbers, passes from step to step. An `Instant` is the scene with its
    motion at one time. A subclass that reads the energy ledger, `Instant.work`, sets `needs_ledger
    = True`. The example adds up the time in s during which a contact force exceeds a limit:

    ```python
    import clearjoint as cj
    import jax.numpy as jnp

    class TimeAbove(cj.extend.AbstractReduction):
        joint: str
        force: float  # N

        def start(self, now):
            return now.time, jnp.zeros(())

        def update(self, tally, now):
            before, above = tally
            largest = cj.quantities.ContactForce(self.joint)(now)
            step = now.time - before
            return now.time, above + jnp.where(largest > self.force, step, 0.0)

        def results(self, tally, now):
            return {"": tally[1]}

        def units(self):
            return {"": "s"}

    outputs = {"overload": TimeAbove("shoulder", force=500.0)}
    ```

    `clearjoint.predictor` differentiates those results, named in `differentiated`, that are
    functions of values of quantities at few instants, such as the peak, and of integrals between
    instants. For them, a subclass defines `observed` or `integrands`, `instants` and `combined`.
    """

    needs_ledger: ClassVar[bool] = False
    differentiated: ClassVar[tuple[str, ...]] = ()
    finds_instants: ClassVar[bool] = False
    """Whether the method `instants` needs the results of the run, as for the time of a peak."""

    def observed(self) -> tuple[Quantity, ...]:
        """Return the quantities whose values at instants determine the `differentiated` results."""
        return ()

    def integrands(self) -> tuple[Quantity, ...]:
        """Return the quantities whose integrals over time, from the start of the run to instants,
        determine the `differentiated` results."""
        return ()

    def instants(self, results: Mapping[str, Scalar], span: tuple[float, float]) -> Times:
        """Return the instants, s, at which `observed` quantities are evaluated, and until which
        `integrands` are integrated, in a run over the time `span`, s. `results` are those of this
        reduction in the run if it `finds_instants`, otherwise empty."""
        raise NotImplementedError

    def combined(
        self, values: Float[Array, "instants values"], instants: Times
    ) -> dict[str, Scalar]:
        """Return the `differentiated` results, by operations of JAX. Row k of `values` has the
        `observed` quantities at instants[k], then the integrals of `integrands` up to this time."""
        raise NotImplementedError

    def check(self, scene: Scene) -> None:
        """Check that a scene has the bodies, joints and contacts that the reduction names.

        Called before each run. By default all fields that are quantities are checked.

        **Raises:** `ValueError` for a name that the scene lacks; the message lists the known names.
        """
        for name, value in vars(self).items():
            check_quantity(name, value, scene)

    @abc.abstractmethod
    def start(self, now: Instant) -> PyTree:
        """Return the tally at the start of the run, where `now.inside` and `now.middle` raise a
        `ValueError`. `update` must return a PyTree of the same structure, shapes and types."""

    @abc.abstractmethod
    def update(self, tally: PyTree, now: Instant) -> PyTree:
        """Return the tally after an accepted step, from the `tally` at the start of the step.

        The method is also called after a rejected attempt, with the time unchanged; the result is
        then discarded.

        **Arguments:** `now`: the instant at the end of the step. `now.inside(x)` is the instant at
        which a part x, 0 to 1, of the step's time has passed; `now.middle` is the same for x = 0.5.
        """

    @abc.abstractmethod
    def results(self, tally: PyTree, now: Instant) -> dict[str, Scalar]:
        """Return the results by name, from the last `tally` and the instant at the end of the run,
        where `now.inside` and `now.middle` raise a `ValueError`.

        The result "" gets the name under which the user has requested the output. The other names
        are appended to it after an underscore: "time" of the output "force" becomes "force_time".
        """

    @abc.abstractmethod
    def units(self) -> dict[str, str]:
        """Return the unit of each result, with the keys of the dictionary from `results`."""


def result_name(name: str, part: str) -> str:
    """Return the name of a part of an output, such as "force_time" for the part "time" of the
    output "force"; "force" for the part ""."""
    return f"{name}_{part}" if part else name


def optional_time(value: Instants, argument: str = "time", unit: str = "s") -> Instants:
    """Convert a time, s, to a Python float; return ``None`` and functions unchanged. Raise a
    `ValueError` if the time is NaN or not a single number."""
    if value is None or callable(value):
        return value
    time = np.asarray(as_number(value, argument, unit))
    is_time = time.shape == () and not bool(np.isnan(time))
    remedy = "give one number, or a function of the scene"
    require(is_time, argument, value, "a time in s", remedy)
    return float(time)


@dataclass(frozen=True)
class TimeSpan:
    """Window of time [after, until) in one run, s; ``None`` for the start or end of the run."""

    after: Scalar | None
    until: Scalar | None

    @property
    def is_whole(self) -> bool:
        """Whether the window is the whole run, so that operations on it can be left out."""
        return self.after is None and self.until is None

    @property
    def start(self) -> Scalar:
        return -math.inf if self.after is None else self.after

    @property
    def end(self) -> Scalar:
        return math.inf if self.until is None else self.until

    def holds(self, time: Scalar) -> Condition:
        return (time >= self.start) & (time < self.end)

    def fractions(self, begin: Scalar, end: Scalar) -> tuple[Scalar, Scalar]:
        """Return where the window begins and ends within a step from `begin` to `end`, s, as
        fractions of the step, 0 to 1; both are equal if no part of the step is in the window."""
        length = jnp.where(end > begin, end - begin, 1.0)
        at_start, at_end = (self.start - begin) / length, (self.end - begin) / length
        return jnp.clip(at_start, 0.0, 1.0), jnp.clip(at_end, 0.0, 1.0)

    def if_reached(self, value: Scalar, time: Scalar) -> Scalar:
        """Return `value`, a result of a run that ended at `time`, s; NaN if the window is later."""
        return value if self.after is None else jnp.where(time > self.after, value, jnp.nan)

    def if_ahead(self, value: Scalar, time: Scalar) -> Scalar:
        """Return `value`, a tally at a run's start `time`, s; NaN if the window ends by then."""
        return value if self.until is None else jnp.where(time < self.until, value, jnp.nan)


@dataclass(frozen=True)
class Window:
    """Window of time, whose edges may be functions of the scene. Raises a `ValueError` for a time
    that is NaN or not a single number, and if `until` is not later than `after`."""

    after: Instants
    until: Instants

    def __post_init__(self) -> None:
        # The class is frozen, so its fields are set by `object`.
        for name in ("after", "until"):
            object.__setattr__(self, name, optional_time(getattr(self, name)))
        if not (callable(self.after) or callable(self.until)):
            span, later = TimeSpan(self.after, self.until), f"later than after = {self.after}"
            require(span.end > span.start, "until", self.until, later, "give both times in s")

    def at(self, now: Instant) -> TimeSpan:
        """Return the `TimeSpan` of the window in the run to which the instant `now` belongs."""

        def edge(name: str, time: Instants) -> Scalar | None:
            if isinstance(time, Callable):
                return real_number(name, time, now.scene, "return one time in s")
            return time

        return TimeSpan(edge("after", self.after), edge("until", self.until))


class AbstractWindowedReduction(AbstractReduction):
    """Base class of reductions over a window of time, from `after` to just before `until`. A
    subclass gets the window's `TimeSpan` by `self._window(now)`, at any instant of the run."""

    after: Instants = eqx.field(default=None, static=True, converter=optional_time, kw_only=True)
    until: Instants = eqx.field(default=None, static=True, converter=optional_time, kw_only=True)

    @override
    def __check_init__(self):
        Window(self.after, self.until)  # raises an error for wrong times

    @override
    def instants(self, results: Mapping[str, Scalar], span: tuple[float, float]) -> Times:
        """Return the start and the end, s, of that part of the window that lies in the run's
        `span`. `results` are not used."""
        for name in ("after", "until"):
            edge, remedy = getattr(self, name), "give a time in s, which derivatives hold fixed"
            require(not callable(edge), name, edge, "a number in reverse mode", remedy)
        window = TimeSpan(self.after, self.until)  # pyright: ignore[reportArgumentType]
        return max(span[0], float(window.start)), min(span[1], float(window.end))

    def _window(self, now: Instant) -> TimeSpan:
        return Window(self.after, self.until).at(now)
