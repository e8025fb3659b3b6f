"""Notebooks run from top to bottom, in this process, and are stored without outputs."""

from pathlib import Path

import matplotlib.pyplot as plt
import nbformat
import pytest

FOLDER = Path(__file__).resolve().parents[1] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
EXPECTED = {
    "double_pendulum": (
        "degrees of freedom: 7",
        "reaction / contact force of one base: 0.499",
    ),
    "clearance_sweep": (
        "max_steps_reached: ",
        "successful: ",
        "peak force goes about with clearance^0.",
        "steps to the end",
    ),
    "identification": (
        "the first 30 ms alone: {'young': False",
        "30 ms: 0 valleys before the truth",
        "The record ends at 100 ms, beyond what a fit by a single run can use",
        ", p = 0\n",
        "2 series to 0.1 s: converged",
        "young        error / bound 1.00,  +0.2 errors off the truth",
    ),
}
"""What each notebook prints, among other things."""


def code(file):
    """The cells that are run."""
    return [cell for cell in nbformat.read(file, as_version=4).cells if cell.cell_type == "code"]


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_is_stored_without_outputs(file):
    cells = code(file)
    assert cells
    assert all(cell.outputs == [] and cell.execution_count is None for cell in cells)


@pytest.mark.parametrize("name", EXPECTED)
def test_runs_in_its_quick_setting(name, monkeypatch, capsys):
    monkeypatch.setenv("CLEARJOINT_QUICK", "1")
    monkeypatch.setattr(plt, "show", lambda: plt.close("all"))
    names = {"__name__": "__main__"}
    for cell in code(FOLDER / f"{name}.ipynb"):
        exec(compile(cell.source, f"{name}.ipynb", "exec"), names)
    text = capsys.readouterr().out
    assert [line for line in EXPECTED[name] if line not in text] == []


def test_every_notebook_is_run():
    assert {file.stem for file in NOTEBOOKS} == set(EXPECTED)
