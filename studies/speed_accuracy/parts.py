"""Work-precision diagrams, and the table of variants."""

from collections.abc import Callable, Iterator, Mapping, Sequence

from studies.common.output import Output
from studies.common.report import markdown
from studies.speed_accuracy import figures, settings
from studies.speed_accuracy.front import front, standings
from studies.speed_accuracy.runs import Point, Spans, measured
from studies.speed_accuracy.variants import (
    Rounded,
    Row,
    memories,
    precisions,
    smoothings,
    stabilisations,
)

CIRCLED = ("preview", "default", "accurate", "reference")


def trajectory(point: Point) -> tuple[float, float]:
    """Return the right-hand sides to the horizon, and the error of positions before it."""
    return point.short_evaluations, point.error


def energy(point: Point) -> tuple[float, float]:
    """Return the time of the long run, s, and its energy error."""
    return point.seconds, point.residual


def evaluations(point: Point) -> tuple[float, float]:
    """Return the right-hand sides of the long run, and its energy error."""
    return point.evaluations, point.residual


POINT_COLUMNS = (
    "setting", "error, m", "right-hand sides", "ledger", "attempts", "right-hand sides", "ms"
)  # fmt: skip


def point_rows(points: Sequence[Point]) -> list[tuple[str, ...]]:
    """Return the table of settings as text."""
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
    """Draw the diagram, and return its table, its front, and the dominated families."""
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
    """Return the table of families as text."""
    rows: list[tuple[str, ...]] = [("family", "least excess", "median", "nearest", "")]
    for one in standings(points, measure, lambda point: point.setting.family):
        verdict = "dominated" if one.dominated else ""
        rows.append((one.family, f"{one.least:.2f}", f"{one.middle:.2f}", one.nearest, verdict))
    return markdown(rows)


ROW_COLUMNS = (
    "variant", "error, m", "peak, N", "dissipated, J", "drift, m", "ledger", "attempts", "ms"
)  # fmt: skip


def variants(output: Output, spans: Spans) -> Iterator[str]:
    """Yield the tables of stabilisations, laws, smoothing widths and precisions, and draw them."""
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
    """Return the table of variants as text."""
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
    """Return the table of precisions as text."""
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
