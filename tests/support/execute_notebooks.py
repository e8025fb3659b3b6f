"""Execute notebooks and store their outputs: `python -m tests.support.execute_notebooks`.

It needs the extra `notebooks`. Names of notebooks may follow; by default all are executed. Sliders
are left out, since only a running kernel can draw them. The cells run in this process: with kernels
of their own, `jupyter nbconvert` waited for ever in some notebooks.
"""

import base64
import os
import sys
from pathlib import Path
from typing import Any

import nbformat
from IPython.core.interactiveshell import InteractiveShell
from IPython.utils.capture import capture_output
from matplotlib_inline.backend_inline import flush_figures
from nbformat import v4

FOLDER = Path(__file__).resolve().parents[2] / "notebooks"


class Shell(InteractiveShell):
    def enable_gui(self, gui: Any = None) -> None:
        """The inline backend of Matplotlib needs no event loop."""


def outputs_of(shell: InteractiveShell, source: str) -> list[Any]:
    """The outputs of a cell. An error of the cell is raised."""
    with capture_output() as captured:
        result = shell.run_cell(source, store_history=True)
        flush_figures()
    result.raise_error()
    outputs = []
    if captured.stdout:
        outputs.append(v4.new_output("stream", name="stdout", text=captured.stdout))
    for output in captured.outputs:
        data = {
            kind: base64.b64encode(part).decode() if isinstance(part, bytes) else part
            for kind, part in output.data.items()
        }
        outputs.append(v4.new_output("display_data", data=data))
    return outputs


def execute(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    Shell.clear_instance()
    shell = Shell.instance()
    shell.run_line_magic("matplotlib", "inline")
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    for count, cell in enumerate(cells, 1):
        cell.outputs, cell.execution_count = outputs_of(shell, cell.source), count
    for cell in notebook.cells:
        cell.metadata.clear()
    nbformat.write(notebook, path)


if __name__ == "__main__":
    sys.modules["ipywidgets"] = None  # type: ignore[assignment]
    os.chdir(FOLDER)
    for name in sys.argv[1:] or sorted(path.stem for path in FOLDER.glob("*.ipynb")):
        execute(FOLDER / f"{name}.ipynb")
        print(name)
