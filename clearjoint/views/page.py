"""A page that shows a mechanism in a browser, in one file, with no network and no server.

Which library, measured with 12 bodies in 500 frames, Chromium 141 with the network off:

| | k3d 3.2.0 | viser 1.1.1 |
|---|---|---|
| the file | 1.46 MB | 1.00 MB |
| until it shows, by software | 2.5 s | 1.8 s |
| time shown, and slider | any, by its hook for code | that of the playback only |
| to write the file | nothing runs | a web server runs |
| colour, size and place over time | one series each | one message each |
| packages it brings | ipywidgets, which notebooks have | requests, rich, imageio, websockets<17 |
| latest releases | 5 in the last 2 months | 5 in the last 5 months |

Both work offline and are kept well; k3d is taken for the time that it shows and since nothing
listens on any port. Poses go into the file once for each frame, solids once: 501 frames of a
four-bar, a slider-crank or the robot arm, with arrows and modes, are 1.3 to 1.5 MB.
"""

import json
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .camera import FIELD_OF_VIEW, Camera
from .meshes import needed
from .parts import MODES, DrawnPart

SCRIPT = Path(__file__).with_name("page.js")
WITHOUT_WEBGL = Path(__file__).with_name("without_webgl.js")
LASTS = 8.0
"""Time that a motion takes to play once, s."""


@dataclass(frozen=True)
class Legend:
    """What a picture says of itself: a `title`, `entries` of a colour and what it stands for, and
    `notes`."""

    title: str
    entries: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]


def page(
    parts: Sequence[DrawnPart],
    camera: Camera,
    legend: Legend,
    times: np.ndarray | None,
    height: int,
) -> str:
    """The page's text.

    **Arguments:** `times`: (N,) s, or ``None`` of a mechanism that stands still. `height`: in a
    notebook, pixels.
    """
    k3d = needed("k3d")
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Given trait value dtype")
        plot = k3d.plot(
            camera_auto_fit=False,
            grid_visible=False,
            menu_visibility=False,
            camera_fov=FIELD_OF_VIEW,
            background_color=0xFFFFFF,
            height=height,
            name=legend.title,
        )
        plot.snapshot_type = "full"
        for part in parts:
            plot += _drawable(part, k3d)
        plot.camera = [*camera.eye.tolist(), *camera.target.tolist(), *camera.up.tolist()]
        said = {
            "title": legend.title,
            "entries": legend.entries,
            "notes": legend.notes,
            "times": None if times is None else [float(f"{time:.7g}") for time in times],
            "lasts": LASTS,
        }
        script = SCRIPT.read_text(encoding="utf-8")
        text = plot.get_snapshot(additional_js_code=script.replace("SAID", _as_script(said)))
    # k3d never calls the script above where there is no WebGL, so this one stands by itself.
    before, end, after = text.rpartition("</body>")
    return f"{before}<script>{WITHOUT_WEBGL.read_text(encoding='utf-8')}</script>{end}{after}"


def _drawable(part: DrawnPart, k3d):
    """One of k3d's: what moves has a time series of homogeneous matrices."""
    mesh = k3d.mesh(
        part.mesh.vertices.astype(np.float32),
        part.mesh.faces.astype(np.uint32),
        color=_number(part.colour_at(0)),
        opacity=part.opacity,
        flat_shading=True,
        side="double",
        name=part.name,
    )
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


def _as_script(value: object) -> str:
    """JSON that may stand in a script of a page, whatever names there are."""
    return json.dumps(value).replace("<", "\\u003c")
