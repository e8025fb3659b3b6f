"""Notebooks run from top to bottom, in this process, and are stored with their outputs."""

import re
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import nbformat
import pytest

from tests.support.slow import slow_but

FOLDER = Path(__file__).resolve().parents[1] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
EXPECTED = {
    "start_here": (
        "degrees of freedom: 7",
        "reaction / contact force of one base: 0.499",
        "first impact at 10.1 ms: 1466 N",
    ),
    "outputs": (
        "hits         Impacts of ",
        "take simulate() or sweep() for it",
        "derivatives of x, y besides x, y, meets, hits",
        " draws: largest force ",
        "clearance: 0.000",
    ),
    "own_mechanism": (
        "degrees of freedom: 7",
        "redundant constraints: none",
        "largest error: ",
        "friction: ",
    ),
    "sweeps_and_bifurcations": (
        "successful: ",
        " lanes have the crank's period",
        "the peak force goes about with clearance^",
    ),
    "fit_to_data": ("2 series to 0.1 s: converged", ", p = 0\n", "standard errors off the truth"),
    "what_data_can_tell": (
        "the first 30 ms alone: {'restitution': ",
        "y alone can tell: {'restitution': True",
        "30 ms: 0 valleys before the truth",
    ),
    "speed_against_accuracy": ("the tight run itself is right to about ", "m apart at"),
    "own_law": (
        "found: stored_energy is not the integral of elastic_force over the depth.",
        "the liner passes",
        "with 8 degrees of freedom",
    ),
    "robot_backlash": (
        *("degrees of freedom: 1", "first crossing ends at "),
        " deg, true: 0.5 deg",
    ),
    "how_long_does_a_joint_live": (
        "reached the cycles in ",
        "slider pin bearing rate -1.0",
        "pin's length         +",
    ),
}
"""What each notebook prints, among other things, in both settings."""


def code(file):
    """The cells that are run."""
    return [cell for cell in nbformat.read(file, as_version=4).cells if cell.cell_type == "code"]


def lacking(name, monkeypatch, capsys):
    """What is expected of a notebook and not printed when it runs, without sliders."""
    monkeypatch.setitem(sys.modules, "ipywidgets", None)
    monkeypatch.setattr(plt, "show", lambda: plt.close("all"))
    names = {"__name__": "__main__"}
    for cell in code(FOLDER / f"{name}.ipynb"):
        exec(compile(cell.source, f"{name}.ipynb", "exec"), names)
    text = capsys.readouterr().out
    return [line for line in EXPECTED[name] if line not in text]


REMEDY = "execute it again, as notebooks/README.md describes"
COLOUR = re.compile(r"\x1b\[[\d;]*m")
OF_A_MACHINE = re.compile(
    r"Traceback \(most recent"
    r"|(?<![\w.:/])(?:~|/home|/opt|/root|/tmp|/usr|/var|/Users)/\S+"
    r"|\b[A-Z]:\\\S+"
)
"""An error, or the path of a file on the machine that executed a notebook."""
LARGEST = 6_000_000
"""Largest size of a stored notebook, bytes."""


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_is_stored_with_outputs(file):
    cells = code(file)
    counts = [cell.execution_count for cell in cells]
    assert counts == list(range(1, len(cells) + 1)), f"not run from top to bottom: {REMEDY}"
    outputs = [output for cell in cells for output in cell.outputs]
    text = "".join(output.text for output in outputs if output.get("name") == "stdout")
    assert [line for line in EXPECTED[file.stem] if line not in text] == [], REMEDY
    draws = any(re.search(r"\bplot\.|\bplt\.show", cell.source) for cell in cells)
    has_picture = any("image/png" in output.get("data", {}) for output in outputs)
    assert has_picture or not draws, f"no picture: {REMEDY}"
    stored = file.read_text(encoding="utf-8")
    assert len(stored) < LARGEST and "iopub" not in stored, f"too large, or with times: {REMEDY}"


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_stored_outputs_are_no_errors_and_name_no_machine(file):
    outputs = [output for cell in code(file) for output in cell.outputs]
    assert not any(o.output_type == "error" or o.get("name") == "stderr" for o in outputs), REMEDY
    # IPython prints an error of a method such as `_repr_html_` as text.
    shown = [{"text": o.get("text", ""), **o.get("data", {})} for o in outputs]
    texts = [str(data[kind]) for data in shown for kind in data if not kind.startswith("image/")]
    plain = "\n".join(COLOUR.sub("", text) for text in texts)
    assert [match[0] for match in OF_A_MACHINE.finditer(plain)] == [], REMEDY


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_links_lead_somewhere(file):
    text = "\n".join(cell.source for cell in nbformat.read(file, as_version=4).cells)
    links = [link for link in re.findall(r"\]\(([^)#\s]+)\)", text) if "://" not in link]
    assert [link for link in links if not (FOLDER / link).exists()] == []


@pytest.mark.parametrize("name", slow_but(["start_here"], EXPECTED))
def test_runs_in_its_quick_setting(name, monkeypatch, capsys):
    """What the others call has tests of its own."""
    monkeypatch.setenv("CLEARJOINT_QUICK", "1")
    assert lacking(name, monkeypatch, capsys) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", EXPECTED)
def test_runs_as_it_is(name, monkeypatch, capsys):
    monkeypatch.delenv("CLEARJOINT_QUICK", raising=False)
    assert lacking(name, monkeypatch, capsys) == []


def test_every_notebook_is_run():
    assert {file.stem for file in NOTEBOOKS} == set(EXPECTED)
