"""How far the program can be pushed before it says no.

    python -m studies.extremes
    python -m studies.extremes --quick

One number after the other is driven over its range where the answer is known in closed form, then
2100 random scenes have all of them at once. Each is right within a stated error, or refused with a
reason: a result code, or a `ValueError` before anything runs. None may be wrong.

What the study found, and what was changed in clearjoint for it:

- Landing within 1e-12 m of an onset is deeper than a whole impact at 1e-9 m/s or of a gram on 1e14
  N/m^1.5: energy came from nothing, up to several times what there was. Steps now land within 1e-11
  s of the event at the contact's rate.
- A journal could go through the wall and come out on the far side with code "successful" (soft
  laws, fast or tilted journals). Penetration beyond the journal's radius now ends a run:
  `left_bearing`.
- A hinge of a closed chain askew by 1e-6 rad put the motion off by 1e-3 in a second. Constraints
  that nearly depend on the others are now refused.
- Without any tolerance a run at time zero shrank its steps for ten million attempts. Both are
  refused: such tolerances, and steps that no longer move the time from zero.
- States with NaN in their memory or ledger, or with Euler parameters of no length, ran until the
  steps were too small. They are refused.
- A rejected step's error, 1e100, overflowed in 32-bit floats.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import clearjoint as cj
from studies.extreme.families import FAMILIES
from studies.extreme.figure import drawn_map
from studies.extreme.looks import WRONG, Row
from studies.extreme.random_scenes import Batch, batch
from studies.extreme.refusals import Refusal, refusals
from studies.extreme.report import case_table, family_table, refusal_table
from studies.extreme.single_runs import single_rows
from studies.output import Output

SCENES, QUICK_SCENES = 300, 48
MAX_STEPS, QUICK_MAX_STEPS = 100_000, 5_000
SEED = 2
QUICK_FAMILIES = ("thrown journal",)


@dataclass(frozen=True)
class Findings:
    """Rows of the map, families of random scenes, and refusals."""

    rows: tuple[Row, ...]
    batches: tuple[Batch, ...]
    refused: tuple[Refusal, ...]

    def wrong(self) -> int:
        """Looks and random scenes that claim success and are not right, and bad numbers taken."""
        looks = sum(row.count(WRONG) for row in self.rows)
        scenes = sum(len(one.wrong()) for one in self.batches)
        return looks + scenes + sum(not one.said for one in self.refused)


def find(quick: bool, scenes: int, seed: int) -> Findings:
    """Run everything; in the quick setting one family and its cases."""
    names, steps = (QUICK_FAMILIES, QUICK_MAX_STEPS) if quick else (FAMILIES, MAX_STEPS)
    batches = [batch(name, scenes, seed, steps) for name in names]
    rows = [row for one in batches for row in one.rows]
    rows += [] if quick else single_rows()
    return Findings(tuple(rows), tuple(batches), tuple(refusals()))


def report(findings: Findings) -> str:
    """All tables."""
    parts = (
        case_table(findings.rows),
        family_table(findings.batches),
        refusal_table(findings.refused),
        f"Wrong in all: {findings.wrong()}.",
    )
    return "\n\n".join(parts)


def main(arguments: list[str] | None = None) -> None:
    """Run the study from a command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="one family and some dozen scenes")
    parser.add_argument("--scenes", type=int, help=f"random ones a family; {SCENES}")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--output", type=Path, default=Path("results/extremes"), help="folder")
    chosen = parser.parse_args(arguments)
    cj.configure()
    scenes = chosen.scenes or (QUICK_SCENES if chosen.quick else SCENES)
    findings = find(chosen.quick, scenes, chosen.seed)
    print(report(findings))
    chosen.output.mkdir(parents=True, exist_ok=True)
    output = Output(chosen.output, chosen.quick)
    output.save(drawn_map(findings.rows, findings.batches), "extremes")
    print(f"Map: {chosen.output}")
    if findings.wrong():
        raise SystemExit("error: some numbers are wrong, see above")


if __name__ == "__main__":
    main()
