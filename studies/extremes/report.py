"""Tables of the study of extremes."""

from collections import Counter
from collections.abc import Iterable, Sequence

from studies.common.report import markdown
from studies.extremes.entries import REFUSED, RIGHT, WRONG, Row
from studies.extremes.random_scenes import Batch
from studies.extremes.refusals import Refusal


def case_table(rows: Iterable[Row]) -> str:
    """Return the table of cases."""
    lines = [("case", "range", "right", "refused", "wrong", "check", "largest error (allowed)")]
    for row in rows:
        values = [entry.value for entry in row.entries]
        unit = "" if row.unit == "1" else f" {row.unit}"
        reasons = f" ({row.reasons})" if row.reasons else ""
        extent = f"{min(values):g} .. {max(values):g}{unit}"
        right, refused, wrong = (str(row.count(kind)) for kind in (RIGHT, REFUSED, WRONG))
        error = f"{row.worst:.0e} ({row.bound:g})"
        lines.append((row.name, extent, right, refused + reasons, wrong, row.check, error))
    return markdown(lines)


def family_table(batches: Sequence[Batch]) -> str:
    """Return the table of random scenes."""
    largest = "largest violation (allowed: 1)"
    head = "random scenes", "all", "successful", "refused", "wrong", largest
    lines = [head, *(_family_line(one.family, [one]) for one in batches)]
    if len(batches) > 1:
        lines.append(_family_line("all", batches))
    return markdown(lines)


def _family_line(name: str, batches: Sequence[Batch]) -> tuple[str, ...]:
    codes: Counter[str] = sum((one.codes() for one in batches), Counter())
    refused = {code: n for code, n in codes.items() if code != "successful"}
    codes_text = ", ".join(f"{n} {code}" for code, n in sorted(refused.items())) or "0"
    worst: dict[str, float] = {}
    for one in batches:
        for invariant, value in one.worst().items():
            if invariant != "penetration":
                worst[invariant] = max(value, worst.get(invariant, 0.0))
    closest = max(worst, key=lambda key: worst[key], default="")
    nearest = f"{closest}, {worst[closest]:.2g}" if closest else ""
    wrong = sum(len(one.wrong()) for one in batches)
    return name, str(codes.total()), str(codes["successful"]), codes_text, str(wrong), nearest


def refusal_table(refused: Iterable[Refusal]) -> str:
    """Return the table of refusals."""
    rows = [(one.attempt, one.message or "none: WRONG") for one in refused]
    return markdown([("attempt", "error message"), *rows])
