"""Measurements as Markdown tables and JSON files."""

import json
import os
import platform
import time
from collections.abc import Sequence
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any

Record = dict[str, Any]
PACKAGES = ("jax", "jaxlib", "diffrax", "numpy", "scipy", "exudyn")


def markdown(rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table; the first row is its head."""
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([lines[0], "|" + "---|" * len(rows[0]), *lines[1:]])


def report(file: Path | None, rows: Sequence[Sequence[str]], records: Sequence[Record]) -> None:
    """Print the rows as a table, and write the records as JSON if there is a file to write to."""
    print(markdown(rows))
    if file is None:
        return
    about = {
        "time": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
        "machine": f"{platform.platform()}, {os.cpu_count()} cores",
        "python": platform.python_version(),
        "packages": {name: version(name) for name in PACKAGES if find_spec(name)},
        "rows": records,
    }
    file.write_text(json.dumps(about, indent=1), encoding="utf-8")


def medians(records: Sequence[Record]) -> list[tuple[str, ...]]:
    """Rows for repeated measurements: one for each value of the first entry, and of the others
    medians and least values."""
    key, *names = records[0]
    rows = [(key, *(f"{name} (least)" for name in names))]
    for value in dict.fromkeys(record[key] for record in records):
        chosen = [record for record in records if record[key] == value]
        columns = ([record[name] for record in chosen] for name in names)
        cells = (f"{median(cells):.3g} ({min(cells):.3g})" for cells in columns)
        rows.append((str(value), *cells))
    return rows
