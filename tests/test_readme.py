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


def test_process_pools_stand_behind_the_guard_of_a_script():
    """The processes import the script."""
    (block,) = re.findall(r"```python\n((?:(?!```).)*get_context.*?)```", README, re.DOTALL)
    guard = block.index('if __name__ == "__main__":\n')
    assert guard < block.index("ProcessPoolExecutor(")
    for line in block[guard:].splitlines()[1:]:
        assert not line or line.startswith("    ")


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
