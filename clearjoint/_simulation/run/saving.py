"""The argument `save` of runs, which selects the results that a run keeps besides its final
state."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ..._fields.checks import (
    as_number,
    concrete,
    errors_about,
    require,
    require_array_names,
    require_type,
)
from ..._fields.types import ArrayLike
from ..._math.vectors import Scalar
from ..._model.scene import Scene
from ..reductions.base import AbstractReduction, check_reductions
from ..step.settings import checked_times, strictly_rising_times
from ..step.types import Numbers
from .sections import Section, SectionRecorder


@dataclass(frozen=True, eq=False)
class Saving:
    """Selection of the results that a run keeps besides its final state.

    **Arguments:**

    - `times`: (N,) s, strictly rising and within the run, times at which to save the state, in
      `solution.saved`. The states are interpolated by the solver's dense output, so that saving
      does not change the steps.
    - `steps`: keep the states at the start and after every accepted step, in `solution.steps`.
    - `impacts`: keep a table of impacts, with one row for each finished contact, in
      `solution.impacts`. A contact that exists at the start of the run has no row. If steps do not
      end at contact events, because the `landing_tolerance` of the `Settings` is ``None``, contacts
      that begin and end within one step have no row, and the times and speeds of onsets and ends
      are interpolated inside steps.
    - `sections`: Poincaré sections by name, each a `Section`, whose crossings are kept in
      `solution.sections`.
    - `outputs`: reductions by name, such as `Peak`, which are updated at every accepted step. Their
      results are in `solution.outputs`.

    **Raises:** `ValueError` for times that are not finite or do not rise strictly, for an array of
    times that is empty or not one-dimensional, and for fields of other types; for a name of a
    section or an output that is not a non-empty string, contains a slash or backslash, or begins
    with "." or "__", since arrays in files get these names. Times that JAX traces are not checked.

    >>> cj.Saving(np.linspace(0.0, 1.0, 1001), impacts=True).impacts
    True
    """

    times: ArrayLike | None = None
    steps: bool = field(default=False, kw_only=True)
    impacts: bool = field(default=False, kw_only=True)
    sections: Mapping[str, Section] = field(default_factory=dict, kw_only=True)
    outputs: Mapping[str, AbstractReduction] = field(default_factory=dict, kw_only=True)

    def __post_init__(self) -> None:
        for name in ("steps", "impacts"):
            value = getattr(self, name)
            require(isinstance(value, bool), name, value, "True or False", "pass a bool")
        if self.times is not None:
            times = as_number(self.times, "times", "s")
            if concrete(times) is None:
                # An array replaces a list with traced numbers, which NumPy can't convert. The class
                # is frozen, so its fields are set by `object`.
                object.__setattr__(self, "times", times)
            else:
                strictly_rising_times(times, "times")
        for argument, kind, expected, example in (
            ("sections", Section, "a Section", '{"top": cj.Section(crossing, channels, count)}'),
            ("outputs", AbstractReduction, "a reduction", '{"hits": cj.ImpactCount("pin")}'),
        ):
            entries, remedy = getattr(self, argument), f"pass for example {example}"
            require_array_names(argument, entries, remedy)
            for name, entry in entries.items():
                require_type(f"{argument}[{name!r}]", entry, kind, expected, remedy)

    def check(self, scene: Scene, ledger: bool) -> None:
        """Check that a scene has the elements that the sections and the outputs name, and that
        outputs that need the energy `ledger` have it; raise a `ValueError` that names the section
        or the output."""
        check_reductions(self.outputs, scene, ledger)
        for name, section in self.sections.items():
            with errors_about(f"Section {name!r}"):
                section.check(scene)

    def section_recorders(self) -> dict[str, SectionRecorder]:
        """Return the recorder of the crossings of each section, by name."""
        return {name: section.recorder for name, section in self.sections.items()}

    def times_between(self, start_time: Scalar, end_time: Scalar) -> Numbers | None:
        """Return the times to save at as `checked_times`, or ``None`` if there are none."""
        if self.times is None:
            return None
        return checked_times(start_time, end_time, self.times, "times")

    def require_none(self, names: Sequence[str], where: str, remedy: str) -> None:
        """Check that the fields `names` request nothing, which a kind of run cannot keep, or raise
        a `ValueError` that names the field, the kind of run (`where`) and the `remedy`."""
        for name in names:
            value = getattr(self, name)
            is_flag = isinstance(value, bool)
            shown, expected = (value, "False") if is_flag else (sorted(value), "none")
            require(not value, name, shown, f"{expected} {where}", remedy)


EXCEPT_TIMES = ("steps", "impacts", "sections", "outputs")
"""Fields of `Saving` that request other results than states at given times."""


def saving_or_nothing(save: Saving | None) -> Saving:
    """Return `save`, a `Saving` that requests no results for ``None``; raise a `ValueError` for
    another type."""
    remedy = "pass cj.Saving(times), with times in s"
    require_type("save", save, Saving | None, "a Saving or None", remedy)
    return _NOTHING if save is None else save


_NOTHING = Saving()
