"""Where studies put their stores and figures."""

from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image

import clearjoint as cj

PALETTE = 128
"""Colours of a picture."""


@dataclass(frozen=True)
class Output:
    """A folder for stores and figures; `quick` studies take few lanes and coarse pictures."""

    folder: Path
    quick: bool = False

    def store(self, name: str) -> Path:
        """Path of a sweep's store; says how much of it is there already."""
        path = self.folder / f"{name}.zarr"
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            done = cj.open_sweep(path)["result"].values != -1
            print(f"{path} has {done.sum()} of {done.size} lanes; what is missing is computed.")
        return path

    def save(self, figure: Figure, name: str) -> None:
        """Write a picture into the folder."""
        save_picture(figure, self.folder / f"{name}.png", 80 if self.quick else 130)


def save_picture(figure: Figure, file: Path, dots_per_inch: int) -> None:
    """Write a picture, with a palette, which makes it a third as large."""
    figure.savefig(file, dpi=dots_per_inch)
    with Image.open(file) as picture:
        small = picture.convert("RGB").quantize(PALETTE)
    small.save(file, optimize=True)
