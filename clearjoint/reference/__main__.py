"""``python -m clearjoint.reference`` writes the reference pages, which need no network."""

import argparse
from pathlib import Path

from .pages import write_pages


def main() -> None:
    """Write the pages and say where they begin."""
    parser = argparse.ArgumentParser(prog="python -m clearjoint.reference", description=__doc__)
    parser.add_argument(
        "folder", nargs="?", type=Path, default=Path("results/reference"), help="%(default)s"
    )
    print(write_pages(parser.parse_args().folder))


if __name__ == "__main__":
    main()
