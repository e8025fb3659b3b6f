"""Runs of random extreme scenes by family."""

from collections import Counter
from dataclasses import dataclass

from studies.extremes.cases import CASES, Case
from studies.extremes.entries import Row, judged
from studies.extremes.families import FAMILIES, Draw, draws
from studies.extremes.runs import Lane, run


@dataclass(frozen=True)
class Batch:
    """Results of a family: random scenes (`draws` and `lanes`), and the rows of its cases."""

    family: str
    draws: tuple[Draw, ...]
    lanes: tuple[Lane, ...]
    rows: tuple[Row, ...]

    def codes(self) -> Counter[str]:
        """Number of lanes with each result code."""
        return Counter(lane.result for lane in self.lanes)

    def wrong(self) -> list[tuple[Draw, Lane]]:
        """Draws with a successful run that violates an invariant."""
        return [(d, lane) for d, lane in zip(self.draws, self.lanes, strict=True) if lane.wrong]

    def worst(self) -> dict[str, float]:
        """Largest violation of each invariant among the successful runs, over the allowed one."""
        good = [lane.violations for lane in self.lanes if lane.successful]
        return {name: max(one[name] for one in good) for name in (good[0] if good else {})}


def batch(name: str, count: int, seed: int, max_steps: int) -> Batch:
    """Run the cases of a family and `count` random scenes together."""
    cases = [case for case in CASES if case.family == name]
    pairs = [(case, value) for case in cases for value in case.values]
    drawn = draws(count, seed)
    trials = [case.trial(value) for case, value in pairs]
    trials += [FAMILIES[name].trial(draw) for draw in drawn]
    lanes = run(name, trials, max_steps)
    ended = iter(lanes)
    rows = tuple(_row(case, [next(ended) for _ in case.values]) for case in cases)
    return Batch(name, tuple(drawn), tuple(lanes[len(pairs) :]), rows)


def _row(case: Case, lanes: list[Lane]) -> Row:
    entries = []
    for value, lane in zip(case.values, lanes, strict=True):
        error = case.error(value, lane.outcome)
        worst = max(lane.violations.values())
        # An invariant that is violated is worse than any error allowed.
        entries.append(judged(value, lane.result, error if worst <= 1.0 else 1.0, case.bound))
    return Row(case.name, case.unit, case.check, case.bound, tuple(entries))
