"""Where studies put their stores and pictures."""

import argparse
from dataclasses import dataclass
from pathlib import Path
from shutil import copyfile

from matplotlib.figure import Figure
from PIL import Image

import clearjoint as cj

PALETTE = 128
"""Colours of a picture."""


@dataclass(frozen=True)
class Output:
    """A folder for stores and pictures; `quick` studies take few lanes and coarse pictures.

    `kept`: the study's own folder, if the pictures in it are renewed too.
    """

    folder: Path
    quick: bool = False
    kept: Path | None = None

    @staticmethod
    def of(study: str, options: argparse.Namespace) -> "Output":
        """The output for `study`, the file of its `__main__`, and the options of `add_options`."""
        own = Path(study).resolve().parent
        folder = Path("results") / own.name
        if options.quick:
            folder = folder / "quick"
        return Output(options.output or folder, options.quick, own if options.renew else None)

    def store(self, name: str) -> Path:
        """Path of a sweep's store; says how much of it is there already."""
        path = self.file(f"{name}.zarr")
        if path.exists():
            done = cj.open_sweep(path)["result"].values != -1
            print(f"{path} has {done.sum()} of {done.size} lanes; what is missing is computed.")
        return path

    def file(self, name: str) -> Path:
        """Path of a file in the folder, which is there from now on."""
        self.folder.mkdir(parents=True, exist_ok=True)
        return self.folder / name

    def save(self, figure: Figure, name: str) -> None:
        """Write a picture, with a palette, which makes it a third as large."""
        file = self.file(f"{name}.png")
        figure.savefig(file, dpi=80 if self.quick else 130)
        with Image.open(file) as picture:
            small = picture.convert("RGB").quantize(PALETTE)
        small.save(file, optimize=True)
        if self.kept is not None and (self.kept / file.name).exists():
            copyfile(file, self.kept / file.name)


def add_options(parser: argparse.ArgumentParser, quick: str) -> None:
    """Add `--quick`, with a line that says what it leaves out, `--renew` and `--output`."""
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--quick", action="store_true", help=quick)
    how.add_argument("--renew", action="store_true", help="replace the pictures beside the study")
    parser.add_argument(
        "--output", type=Path, help="folder for what it writes; results/NAME unless given"
    )
