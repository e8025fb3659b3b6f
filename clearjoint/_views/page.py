"""A page that shows a mechanism in a browser: one file that needs no network and no server.

It is made by the package k3d. Pages of viser are smaller and shown sooner, but k3d shows the time,
writes the file without a web server, and depends on ipywidgets alone.
"""

import json
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .meshes import MODES, DrawnPart, needed
from .proportions import FIELD_OF_VIEW, Camera


@dataclass(frozen=True)
class Legend:
    """Legend: `entries` are pairs of a colour "#rrggbb" and its meaning, `notes` lines of text."""

    title: str
    entries: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]


def page(
    parts: list[DrawnPart], camera: Camera, legend: Legend, times: np.ndarray | None, height: int
) -> str:
    """Return the HTML text of a page. `times`: of the frames, s, ``None`` for a single state;
    `height`: of the view in a notebook, pixels."""
    k3d = needed("k3d")
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Given trait value dtype")  # k3d's own conversions
        plot = k3d.plot(
            camera_auto_fit=False,
            grid_visible=False,
            menu_visibility=False,
            camera_fov=FIELD_OF_VIEW,
            background_color=0xFFFFFF,
            height=height,
            name=legend.title,
        )
        plot.snapshot_type = "full"  # the file contains k3d's own script, too
        for part in parts:
            plot += _drawable(part, k3d)
        plot.camera = [*camera.eye.tolist(), *camera.target.tolist(), *camera.up.tolist()]
        # Seven digits of a time are enough for the display, and keep the file small.
        content = vars(legend) | {
            "times": None if times is None else [float(f"{time:.7g}") for time in times],
            "duration": 8.0,  # s, in which the page plays the whole motion by default
        }
        # `page.js`, which makes the legend and the time slider, has CONTENT in place of `content`.
        # With "<" escaped, no text of the legend can end the script element.
        embedded = json.dumps(content).replace("<", "\\u003c")
        text = plot.get_snapshot(additional_js_code=_script("page").replace("CONTENT", embedded))
    # `without_webgl.js` tells the reader if the browser has no WebGL. In that case, k3d shows
    # nothing and does not run `page.js`.
    before, end, after = text.rpartition("</body>")
    return f"{before}<script>{_script('without_webgl')}</script>{end}{after}"


def _script(name: str) -> str:
    return Path(__file__).with_name(f"{name}.js").read_text(encoding="utf-8")


def _drawable(part: DrawnPart, k3d):
    mesh = k3d.mesh(
        part.mesh.vertices.astype(np.float32),
        part.mesh.faces.astype(np.uint32),
        color=_number(part.colour_at(0)),
        opacity=part.opacity,
        flat_shading=True,
        side="double",
        name=part.name,
    )
    # k3d animates a property that is a dictionary, with frame numbers as keys, and keeps any other
    # property constant.
    matrices = part.poses.astype(np.float32)
    mesh.model_matrix = matrices[0]
    if len(matrices) > 1:
        mesh.model_matrix = {str(k): matrix for k, matrix in enumerate(matrices)}
    if part.modes is not None and len(part.modes) > 1:
        numbers = {mode: _number(colour) for mode, colour in MODES.items()}
        mesh.color = {str(k): numbers[int(mode)] for k, mode in enumerate(part.modes)}
    return mesh


def _number(colour: str) -> int:
    return int(colour[1:], 16)
