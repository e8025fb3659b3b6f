"""Execute notebooks and store their outputs: `python -m tests.support.execute_notebooks`.

It needs the extra `notebooks`. Names of notebooks may follow; by default all are executed. Sliders
are left out, since only a running kernel can draw them. The cells run in this process: with kernels
of their own, `jupyter nbconvert` waited for ever in some notebooks.

Views are stored as pictures: their pages are large, and most viewers of notebooks omit them.
"""

import base64
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import nbformat
from IPython.core.displayhook import DisplayHook
from IPython.core.displaypub import publish_display_data
from IPython.core.interactiveshell import InteractiveShell
from IPython.utils.capture import capture_output
from matplotlib_inline.backend_inline import flush_figures
from nbformat import v4

import clearjoint as cj

FOLDER = Path(__file__).resolve().parents[2] / "notebooks"


class Publishing(DisplayHook):
    """Shows the value of a cell's last line as `display` would, not as text in a terminal."""

    def write_output_prompt(self) -> None:
        """No `Out[3]:`."""

    def write_format_data(self, format_dict: Any, md_dict: Any = None) -> None:
        publish_display_data(format_dict, md_dict)


class Shell(InteractiveShell):
    displayhook_class = Publishing

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


def picture(view: cj.View) -> bytes:
    """A view as PNG, at the end of a run."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "view.png"
        return view.save(file, time=None if view.times is None else view.times[-1]).read_bytes()


def execute(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    Shell.clear_instance()
    shell = Shell.instance()
    formatters = shell.display_formatter.formatters
    formatters["image/png"].for_type(cj.View, picture)
    formatters["text/html"].for_type(cj.View, lambda view: None)
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
