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
MECHANISMS: dict[str, tuple[Callable[[], tuple[Scene, State]], dict[str, str]]] = {
    "double_pendulum": (
        double_pendulum,
        {"joint": "shoulder", "body": "arm 2", "end": "50 ms"}
        | {"every": "0.05 ms", "after": "10 ms"},
    ),
    "four_bar": (
        lambda: four_bar({"crank pin": 0.1e-3}, speed=30.0),
        {"joint": "crank pin", "body": "coupler", "end": "200 ms"}
        | {"every": "0.2 ms", "after": "20 ms"},
    ),
    "slider_crank": (
        lambda: slider_crank(0.1e-3),
        {"joint": "slider pin", "body": "slider", "end": "24 ms"}
        | {"every": "0.02 ms", "after": "12 ms"},
    ),
}
"""Function that returns the scene and the state of a mechanism, and values that replace the
placeholders in the template of its study, by the mechanism's name."""


def example_texts(mechanism: str, scene: str, study: str) -> tuple[str, str]:
    """Return the texts of a scene file and a study file for a mechanism.

    **Arguments:** `mechanism`: key of `MECHANISMS`; `scene`, `study`: names of the two files, which
    occur in the texts.
    """
    make, values = MECHANISMS[mechanism]
    with TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        save(*make(), path)
        saved = path.read_text(encoding="utf-8")
    names = {"scene": scene, "study": study, "title": mechanism.replace("_", " ").capitalize()}
    text = Template(STUDY.read_text(encoding="utf-8")).substitute(values, **names)
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
            FileLocation(str(path)).refuse(
                "a file", "no existing file", "remove it, or choose another folder by --out"
            )
    for path, text in zip((scene, study), example_texts(mechanism, *names), strict=True):
        path.write_text(text, encoding="utf-8")
    return scene, study
