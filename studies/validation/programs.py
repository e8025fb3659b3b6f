"""Other programs that may be installed."""

import importlib.util
from collections.abc import Callable, Mapping

import numpy as np

Runs = Mapping[str, Callable[[], np.ndarray]]
"""Functions that return the values of a program, by the program's name."""


def has(package: str) -> bool:
    """Return whether an optional package is installed."""
    return importlib.util.find_spec(package) is not None


def installed(runs: Runs) -> Runs:
    """Return the runs of the programs that are installed, and print a line for each other one."""
    there = {name: run for name, run in runs.items() if has(name.lower())}
    for name in runs.keys() - there.keys():
        print(f"No rows of {name}, which is not installed: pip install -e '.[{name.lower()}]'")
    return there
