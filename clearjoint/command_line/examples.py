"""`clearjoint new`: example files of a scene and a study."""

from collections.abc import Callable
from pathlib import Path
from string import Template
from tempfile import TemporaryDirectory

from ..model.bodies import State
from ..model.mechanisms.double_pendulum import double_pendulum
from ..model.mechanisms.four_bars import four_bar
from ..model.mechanisms.slider_cranks import slider_crank
from ..model.scene import Scene
from ..scene_files.files import save
from ..scene_files.locations import FileLocation

STUDY = Path(__file__).parent / "templates" / "study.toml"
"""Template of the study files, with placeholders such as ``$joint``."""
SCENE_HEAD = """\
# A scene: bodies, joints, forces, gravity and the initial state. Numbers are in the SI units that
# the comments give. A number in another unit is written as a text: clearance = "0.1 mm".
#
#   clearjoint check {scene}            check that the scene can run
#   clearjoint run {scene} --end 0.1
#
# `clearjoint schema` prints the JSON Schema of scene files, with which editors complete them.

"""
MECHANISMS: dict[str, Callable[[], tuple[Scene, State]]] = {
    "double_pendulum": double_pendulum,
    "four_bar": lambda: four_bar({"crank pin": 0.1e-3}, speed=30.0),
    "slider_crank": lambda: slider_crank(0.1e-3),
}
"""Function that returns the scene and the state of a mechanism, by its name."""
PLACEHOLDERS = {
    "double_pendulum": ("shoulder", "arm 2", "50 ms", "0.05 ms", "10 ms", "1 s"),
    "four_bar": ("crank pin", "coupler", "200 ms", "0.2 ms", "20 ms", "209.43951 ms"),
    "slider_crank": ("slider pin", "slider", "24 ms", "0.02 ms", "12 ms", "12 ms"),
}
"""Joint, body, end, time between saved states, end of the transient, and duration of a cycle that
replace placeholders in the template of the study, by the mechanism's name."""


def example_texts(mechanism: str, scene: str, study: str) -> tuple[str, str]:
    """Return the texts of a scene file and a study file for a mechanism.

    **Arguments:** `mechanism`: key of `MECHANISMS`; `scene`, `study`: names of the two files, which
    occur in the texts.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        save(*MECHANISMS[mechanism](), path)
        saved = path.read_text(encoding="utf-8")
    names = {"scene": scene, "study": study, "title": mechanism.replace("_", " ").capitalize()}
    keys = "joint", "body", "end", "every", "after", "cycle"
    names |= zip(keys, PLACEHOLDERS[mechanism], strict=True)
    text = Template(STUDY.read_text(encoding="utf-8")).substitute(names)
    return SCENE_HEAD.format(scene=scene) + saved, text


def write_example(mechanism: str, folder: Path) -> tuple[Path, Path]:
    """Write the scene file and the study file of a mechanism into a folder; return their paths.

    **Arguments:** `mechanism`: key of `MECHANISMS`; `folder`: is made if it does not exist.

    **Raises:** `ValueError` if one of the files exists; nothing is written then.
    """
    names = f"{mechanism}.toml", f"{mechanism}_study.toml"
    scene, study = folder / names[0], folder / names[1]
    folder.mkdir(parents=True, exist_ok=True)
    for path in (scene, study):
        if path.exists():
            remedy = "remove it, or choose another folder by --out"
            FileLocation(str(path)).refuse("a file", "no existing file", remedy)
    for path, text in zip((scene, study), example_texts(mechanism, *names), strict=True):
        path.write_text(text, encoding="utf-8")
    return scene, study
