"""Folders, stores and pictures of studies."""

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copyfile

from matplotlib.figure import Figure
from PIL import Image

import clearjoint as cj

PALETTE = 128
"""Number of colours of a picture."""


@dataclass(frozen=True)
class Output:
    """Folder for the stores and pictures of a study.

    `quick`: whether the study is small and its pictures are coarse. `kept`: the study's own folder,
    if its pictures are replaced too.
    """

    folder: Path
    quick: bool = False
    kept: Path | None = None

    @staticmethod
    def of(study: str, options: argparse.Namespace) -> "Output":
        """Return the output for a study's `__main__` file and the options of `add_options`."""
        source = Path(study).resolve().parent
        folder = Path("results") / source.name
        if options.quick:
            folder = folder / "quick"
        return Output(options.output or folder, options.quick, source if options.renew else None)

    def store(self, name: str) -> Path:
        """Return the path of a sweep's store, and print how much of it exists."""
        path = self.file(f"{name}.zarr")
        if path.exists():
            done = cj.open_sweep(path)["result"].values != -1
            print(f"{path} has {done.sum()} of {done.size} lanes; the others are computed.")
        return path

    def file(self, name: str) -> Path:
        """Return the path of a file, after making the folder."""
        self.folder.mkdir(parents=True, exist_ok=True)
        return self.folder / name

    def save(self, figure: Figure, name: str) -> None:
        """Write a picture with a palette, which reduces its size to a third."""
        file = self.file(f"{name}.png")
        figure.savefig(file, dpi=80 if self.quick else 130)
        with Image.open(file) as picture:
            small = picture.convert("RGB").quantize(PALETTE)
        small.save(file, optimize=True)
        if self.kept is not None and (self.kept / file.name).exists():
            copyfile(file, self.kept / file.name)


def add_options(parser: argparse.ArgumentParser, quick: str) -> None:
    """Add the options `--quick` (with a line of help), `--renew` and `--output`."""
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--quick", action="store_true", help=quick)
    how.add_argument(
        "--renew", action="store_true", help="replace the pictures in the study's folder"
    )
    parser.add_argument("--output", type=Path, help="output folder; default: results/NAME")


def run_parts(
    study: str,
    text: str | None,
    parts: Mapping[str, Callable[[Output], list[str]]],
    quick: str,
    arguments: Sequence[str] | None,
) -> list[str]:
    """Run the parts of a study that a command line names, print their findings, and return them.

    **Arguments:** `study`, `text`: the study's `__main__` file and its docstring. `parts`: by name,
    functions that return findings; all run by default. `quick`: a line of help. `arguments`: of the
    command line; ``None`` for those of this process.
    """
    parser = argparse.ArgumentParser(description=(text or "").partition("\n")[0])
    parser.add_argument("part", nargs="?", choices=list(parts), help="by default all")
    add_options(parser, quick)
    options = parser.parse_args(arguments)
    cj.configure()
    output = Output.of(study, options)
    names = list(parts) if options.part is None else [options.part]
    lines = [line for name in names for line in parts[name](output)]
    print("\n".join(f"- {line}" for line in lines), flush=True)
    print(f"Figures: {output.folder}")
    return lines
