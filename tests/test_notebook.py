"""Notebooks run from top to bottom, and are stored without outputs."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

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


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_is_stored_without_outputs(file):
    cells = [cell for cell in nbformat.read(file, as_version=4).cells if cell.cell_type == "code"]
    assert cells
    assert all(cell.outputs == [] and cell.execution_count is None for cell in cells)


@pytest.mark.parametrize("name", EXPECTED)
def test_runs_in_its_quick_setting(name, monkeypatch):
    monkeypatch.setenv("CLEARJOINT_QUICK", "1")
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": FOLDER}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    text = "".join(output.get("text", "") for output in outputs)
    assert [line for line in EXPECTED[name] if line not in text] == []


def test_every_notebook_is_run():
    assert {file.stem for file in NOTEBOOKS} == set(EXPECTED)
