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

    `kept`: the study's own folder, whose pictures are renewed too; ``None`` where they are not.
    """

    folder: Path
    quick: bool = False
    kept: Path | None = None

    @staticmethod
    def of(study: str, options: argparse.Namespace, standard: bool = True) -> "Output":
        """The output of a study, the file of its ``__main__``, for the options `add_options` adds.

        A full run in the study's own (`standard`) settings that is given no folder renews the
        pictures beside the study.
        """
        if options.output is not None:
            return Output(options.output, options.quick)
        kept = Path(study).resolve().parent
        folder = Path("results") / kept.name
        if options.quick:
            return Output(folder / "quick", True)
        return Output(folder, False, kept if standard else None)

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
    """Add `--quick`, with a line that says what it leaves out, and `--output`."""
    parser.add_argument("--quick", action="store_true", help=quick)
    parser.add_argument(
        "--output",
        type=Path,
        help="folder for what it writes; results/NAME unless given, and the pictures here",
    )
