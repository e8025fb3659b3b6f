"""Entry point of the program `clearjoint`.

This module is installed outside the package `clearjoint`, so that it can handle Ctrl-C while the
package is imported, which takes a second or more: the program then ends without a traceback. Help
is shown without importing the package.
"""

import importlib.util
import os
import signal
import sys
from collections.abc import Sequence
from types import FrameType


def main() -> None:
    """Run the program with the arguments of the command line."""
    # If the process was started with Ctrl-C ignored, it stays ignored.
    previous = signal.getsignal(signal.SIGINT)
    if previous is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)
    if _asks_for_help(sys.argv[1:]):
        _leave_package_out()
    from clearjoint._command_line.program import main as program

    signal.signal(signal.SIGINT, previous)
    program()


def _asks_for_help(arguments: Sequence[str]) -> bool:
    """Return whether the arguments, such as ``run --help``, only ask for help or for the version,
    so that no command is run."""
    return 0 < len(arguments) <= 2 and arguments[-1] in ("-h", "--help", "--version")


def _leave_package_out() -> None:
    """Let modules of the package be imported without its ``__init__``, which imports JAX and all of
    the package."""
    if "clearjoint" not in sys.modules and (spec := importlib.util.find_spec("clearjoint")):
        sys.modules["clearjoint"] = importlib.util.module_from_spec(spec)


def _end(number: int, frame: FrameType | None) -> None:
    # End at once: an exception could be caught by the code of a module that is being imported.
    del number, frame
    os.write(2, b"interrupted\n")
    os._exit(130)
