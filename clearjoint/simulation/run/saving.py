"""The argument `save` of runs: results that a run keeps besides its final state."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ...fields.checks import concrete, require, require_array_names
from ...fields.types import ArrayLike
from ...math.vectors import Scalar
from ...model.scene import Scene
from ..reductions.reductions import AbstractReduction, check_reductions
from ..step.spans import check_rising, checked_times
from ..step.types import Numbers
from .sections import Section, SectionRecorder


@dataclass(frozen=True, eq=False)
class Saving:
    """Results that a run keeps besides its final state.

        cj.Saving(np.linspace(0.0, 1.0, 1001), impacts=True)

    **Arguments:**

    - `times`: (N,) s, strictly rising, times at which to save the state, in `solution.saved`. Dense
      output gives these states, so that the times do not change the steps.
    - `steps`: keep the state after every accepted step, in `solution.steps`.
    - `impacts`: tabulate all finished contacts, in `solution.impacts`.
    - `sections`: each `Section` by name, whose crossings are kept in `solution.sections`.
    - `outputs`: reductions by name, such as `Peak`, which are updated at every accepted step. Their
      results are in `solution.outputs`.

    **Raises:** `ValueError` for times that do not rise strictly, and for fields of other types.

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
            require(isinstance(value, bool), name, value, "True or False", "say whether")
        if self.times is not None and concrete(self.times) is not None:
            steps = np.diff(check_rising(self.times, "times"))
            remedy = "remove repeated times, for example with numpy.unique"
            require(bool((steps > 0).all()), "times", self.times, "without repetition", remedy)
        remedy = 'pass for example {"top": cj.Section(crossing, channels, count)}'
        require_array_names("sections", self.sections, remedy)
        for name, section in self.sections.items():
            fine, argument = isinstance(section, Section), f"sections[{name!r}]"
            require(fine, argument, type(section).__name__, "a Section", remedy)
        remedy = 'pass for example {"hits": cj.ImpactCount("pin")}'
        require_array_names("outputs", self.outputs, remedy)
        for name, output in self.outputs.items():
            fine, argument = isinstance(output, AbstractReduction), f"outputs[{name!r}]"
            require(fine, argument, type(output).__name__, "a reduction", remedy)

    def check(self, scene: Scene, ledger: bool) -> None:
        """Check that a scene has the elements that the sections and the outputs name.

        **Arguments:** `ledger`: whether the run keeps the energy ledger, which some outputs need.

        **Raises:** `ValueError` that names the section or the output.
        """
        check_reductions(self.outputs, scene, ledger)
        for name, section in self.sections.items():
            try:
                section.check(scene)
            except ValueError as error:
                raise ValueError(f"Section {name!r}: {error}") from error

    def section_recorders(self) -> dict[str, SectionRecorder]:
        """Return a recorder of each section's crossings, by name."""
        return {name: section.recorder for name, section in self.sections.items()}

    def times_between(self, start_time: Scalar, end_time: Scalar) -> Numbers | None:
        """Return the times to save at, (N,) s, or ``None``, after a check of their range.

        **Raises:** `ValueError` for times before `start_time` or after `end_time`, s.
        """
        if self.times is None:
            return None
        return checked_times(start_time, end_time, self.times, "times")

    def require_no_steps(self, where: str, remedy: str) -> None:
        """Check that steps are not requested, for runs that cannot keep them.

        **Arguments:** `where`, `remedy`: texts of the message, such as "of a run with derivatives".

        **Raises:** `ValueError` otherwise.
        """
        require(not self.steps, "steps", True, f"False {where}", remedy)

    def require_times_alone(self, where: str, remedy: str) -> None:
        """Check that nothing but states at given times is requested; as `require_no_steps`."""
        self.require_no_steps(where, remedy)
        require(not self.impacts, "impacts", True, f"False {where}", remedy)
        require(not self.sections, "sections", sorted(self.sections), f"none {where}", remedy)
        self.require_no_outputs(where, remedy)

    def require_no_outputs(self, where: str, remedy: str) -> None:
        """Check that no reductions are requested; arguments and error as of `require_no_steps`."""
        require(not self.outputs, "outputs", sorted(self.outputs), f"none {where}", remedy)


def saving_or_nothing(save: Saving | None) -> Saving:
    """Return the given `Saving`, or for ``None`` a `Saving` that keeps no results.

    **Raises:** `ValueError` for an argument of another type.
    """
    kind = type(save).__name__
    remedy = "pass cj.Saving(times), with times in s"
    require(isinstance(save, Saving | None), "save", kind, "a Saving or None", remedy)
    return Saving() if save is None else save
