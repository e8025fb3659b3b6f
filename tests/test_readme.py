"""The README's Python, from top to bottom in one session, as a reader would run it."""

import re
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

import clearjoint as cj

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
ORDER = [
    "Measured data",
    "What data can tell",
    "Identification",
    "Gradients",
    "Design by gradient",
    "Real measurements",
]
"""Sections of a fit, in the order in which one needs them."""


def test_sections_of_a_fit_follow_each_other():
    sections = re.findall(r"^## (.*)$", README, re.MULTILINE)
    first = sections.index(ORDER[0])
    assert sections[first : first + len(ORDER)] == ORDER


@pytest.mark.slow
def test_all_python_runs(tmp_path, monkeypatch):
    """But for the block that needs a cluster."""
    monkeypatch.chdir(tmp_path)
    (table,) = re.findall(r"```csv\n(.*?)```", README, re.DOTALL)
    Path("rig.csv").write_text(table, encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    names = {}
    for block in blocks:
        if "dask" not in block:
            exec(block, names)
    plt.close("all")
    assert len(blocks) == 8
    assert names["fit"].ending is cj.Ending.CONVERGED
    assert names["found"].derivatives["height"].shape == (1, 3)
