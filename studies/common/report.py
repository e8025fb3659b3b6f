"""Markdown tables and JSON files."""

import json
import os
import platform
import time
from collections.abc import Sequence
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

Record = dict[str, Any]
PACKAGES = ("jax", "jaxlib", "diffrax", "numpy", "scipy", "exudyn")


def markdown(rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table; the first row is its head."""
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([lines[0], "|" + "---|" * len(rows[0]), *lines[1:]])


def report(file: Path | None, rows: Sequence[Sequence[str]], records: Sequence[Record]) -> None:
    """Print the rows as a table, and write the records to a JSON file if one is given."""
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
