"""What accuracy costs: work-precision diagrams, and what they say of solvers, tolerances and laws.

    python -m studies.speed_accuracy [PART] [--quick]

Parts, all of them unless one is named: `diagrams` (solvers, tolerances, landing), `presets` (forces
and first calls), `variants` (stabilisation, memory, smoothing, precision), `statistics` (of long
runs) and `gradients`. What came out stands in the README, "Speed against accuracy".

All runs are of the paper's double pendulum, 0.5 mm, restitution 0.9. Errors are against the
extended-precision reference, which lies beside the checkout (`../shared/reference`), or where it
does not, against clearjoint itself with Dopri8 at rtol 1e-12. Right-hand sides of explicit methods
follow from the tableau (a test counts them), those of implicit ones are counted. Times are the
processor's, of a whole call of `simulate` that saves 51 states. A run is given up after 1.5 million
attempts, an implicit one after 60 000.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import clearjoint as cj
from studies.benchmarks.report import markdown
from studies.output import Output
from studies.work_precision import figures, settings
from studies.work_precision.front import front, standings
from studies.work_precision.gradients import gradients
from studies.work_precision.preset_table import presets
from studies.work_precision.runs import FULL, QUICK, Point, Spans, measured
from studies.work_precision.statistics import statistics
from studies.work_precision.variants import (
    Rounded,
    Row,
    memories,
    precisions,
    smoothings,
    stabilisations,
)

CIRCLED = ("look", "default", "study", "reference")


def trajectory(point: Point) -> tuple[float, float]:
    """Right-hand sides to the horizon, and the error of positions before it."""
    return point.short_evaluations, point.error


def energy(point: Point) -> tuple[float, float]:
    """Seconds of the long run, and what its ledger lacks."""
    return point.seconds, point.residual


def evaluations(point: Point) -> tuple[float, float]:
    """Right-hand sides of the long run, and what its ledger lacks."""
    return point.evaluations, point.residual


POINT_COLUMNS = (
    "setting", "error, m", "right-hand sides", "ledger", "attempts", "right-hand sides", "ms"
)  # fmt: skip


def point_rows(points: Sequence[Point]) -> list[tuple[str, ...]]:
    """Settings with what was measured."""
    return [
        POINT_COLUMNS,
        *(
            (
                str(point),
                f"{point.error:.1e}",
                f"{point.short_evaluations:.0f}",
                f"{point.residual:.1e}",
                f"{point.attempts:.0f}",
                f"{point.evaluations:.0f}",
                f"{1e3 * point.seconds:.0f}",
            )
            for point in points
        ),
    ]


def diagrams(output: Output, spans: Spans) -> list[str]:
    """The diagram, the table behind it, its front, and who is dominated."""
    grid = settings.quick_grid() if output.quick else settings.grid()
    points = [measured(setting, spans) for setting in grid]
    named = () if output.quick else CIRCLED
    circled = [measured(settings.preset(name), spans) for name in named]
    axes = (
        (f"right-hand sides to {spans.short:g} s", "largest error of a position, m", trajectory),
        (f"seconds for {spans.long:g} s", "energy not accounted for / exchanged", energy),
    )
    output.save(figures.diagrams(points, circled, axes), "work_precision")
    lines = [markdown(point_rows([*points, *circled]))]
    named_measures = (
        ("Error of positions by right-hand sides", trajectory),
        ("Ledger by right-hand sides", evaluations),
        ("Ledger by seconds", energy),
    )
    for title, measure in named_measures:
        best = "; ".join(map(str, front(points, measure)))
        lines += [f"\n{title}. On the front: {best}.", standing_table(points, measure)]
    return lines


def standing_table(points: Sequence[Point], measure: Callable) -> str:
    """The families, and which of them are dominated."""
    rows: list[tuple[str, ...]] = [("family", "least excess", "median", "nearest", "")]
    for one in standings(points, measure, lambda point: point.setting.family):
        verdict = "dominated" if one.dominated else ""
        rows.append((one.family, f"{one.least:.2f}", f"{one.middle:.2f}", one.nearest, verdict))
    return markdown(rows)


ROW_COLUMNS = (
    "variant", "error, m", "peak, N", "dissipated, J", "drift, m", "ledger", "attempts", "ms"
)  # fmt: skip


def variants(output: Output, spans: Spans) -> Iterator[str]:
    """Stabilisations, laws, smoothing widths and precisions, with a figure."""
    stable = stabilisations(spans)
    yield f"\nStabilisation, absolute coordinates\n\n{row_table(stable)}"
    yield f"\nMemory\n\n{row_table(memories(spans))}"
    smooth = smoothings(spans)
    for lands, rows in smooth.items():
        yield f"\nSmoothing width in m, landing: {lands}\n\n{row_table(rows)}"
    precise = precisions(spans)
    yield f"\nPrecision\n\n{precision_table(precise)}"
    output.save(figures.variants(smooth, precise, stable), "variants")


def row_table(rows: Sequence[Row]) -> str:
    """Variants beside each other."""
    cells = [
        (
            row.name,
            f"{row.error:.1e}",
            f"{row.peak:.2f}",
            f"{row.dissipated:.3f}",
            f"{row.drift:.0e}",
            f"{row.residual:.0e}",
            f"{row.attempts:.0f}",
            f"{1e3 * row.seconds:.0f}",
        )
        for row in rows
    ]
    return markdown([ROW_COLUMNS, *cells])


def precision_table(precise: Mapping[str, Sequence[Rounded]]) -> str:
    """Precisions beside each other."""
    head = ("precision", "rtol", "error, m", "result", "ledger", "attempts", "ms")
    cells = [
        (
            name,
            f"{row.rtol:.0e}",
            f"{row.error:.1e}",
            row.result,
            f"{row.residual:.0e}",
            f"{row.attempts:.0f}",
            f"{1e3 * row.seconds:.0f}",
        )
        for name, rows in precise.items()
        for row in rows
    ]
    return markdown([head, *cells])


PARTS = {
    "diagrams": diagrams,
    "presets": presets,
    "variants": variants,
    "statistics": statistics,
    "gradients": gradients,
}


def main(arguments: list[str] | None = None) -> None:
    """Run a part of the study, print its tables and write its figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("part", nargs="?", choices=[*PARTS, "all"], default="all")
    parser.add_argument(
        "--quick", action="store_true", help="short runs; diagrams of one solver only"
    )
    parser.add_argument("--output", type=Path, default=Path("results/speed_accuracy"))
    chosen = parser.parse_args(arguments)
    cj.configure()
    output = Output(chosen.output / "quick" if chosen.quick else chosen.output, chosen.quick)
    output.folder.mkdir(parents=True, exist_ok=True)
    spans = QUICK if chosen.quick else FULL
    whole = ["diagrams"] if chosen.quick else list(PARTS)
    for name in whole if chosen.part == "all" else [chosen.part]:
        for lines in PARTS[name](output, spans):
            print(lines, flush=True)
    print(f"Figures: {output.folder}")


if __name__ == "__main__":
    main()
