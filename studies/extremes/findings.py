"""Runs and report of the study of extremes."""

from dataclasses import dataclass

from studies.extremes.entries import WRONG, Row
from studies.extremes.families import FAMILIES
from studies.extremes.random_scenes import Batch, batch
from studies.extremes.refusals import Refusal, refusals
from studies.extremes.report import case_table, family_table, refusal_table
from studies.extremes.single_runs import single_rows

SCENES, QUICK_SCENES = 300, 48
MAX_STEPS, QUICK_MAX_STEPS = 100_000, 5_000
SEED = 2
QUICK_FAMILIES = ("thrown journal",)


@dataclass(frozen=True)
class Findings:
    """Rows of the cases, batches of random scenes, and refusals."""

    rows: tuple[Row, ...]
    batches: tuple[Batch, ...]
    refused: tuple[Refusal, ...]

    def wrong(self) -> int:
        """Number of wrong results, and of impossible numbers that were accepted."""
        entries = sum(row.count(WRONG) for row in self.rows)
        scenes = sum(len(one.wrong()) for one in self.batches)
        return entries + scenes + sum(not one.message for one in self.refused)


def find(quick: bool, scenes: int, seed: int) -> Findings:
    """Run all cases and random scenes; in the quick setting one family and its cases."""
    names, steps = (QUICK_FAMILIES, QUICK_MAX_STEPS) if quick else (FAMILIES, MAX_STEPS)
    batches = [batch(name, scenes, seed, steps) for name in names]
    rows = [row for one in batches for row in one.rows]
    rows += [] if quick else single_rows()
    return Findings(tuple(rows), tuple(batches), tuple(refusals()))


def report(findings: Findings) -> str:
    """Return all tables as text."""
    parts = (
        case_table(findings.rows),
        family_table(findings.batches),
        refusal_table(findings.refused),
        f"Wrong in all: {findings.wrong()}.",
    )
    return "\n\n".join(parts)
