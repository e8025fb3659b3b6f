"""Entry point of the program `clearjoint`.

This module is installed outside the package `clearjoint`, so that it can handle Ctrl-C while the
package is imported, which takes a second or more: the program then ends without a traceback.
"""

import os
import signal
import sys
from importlib.util import find_spec, module_from_spec
from types import FrameType


def main() -> None:
    """Run the program with the arguments of the command line."""
    # If the process was started with Ctrl-C ignored, it stays ignored.
    previous = signal.getsignal(signal.SIGINT)
    if previous is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)
    # For help or the version alone, modules of the package are imported without its `__init__`,
    # which imports JAX and all of the package.
    is_help = len(sys.argv) in (2, 3) and sys.argv[-1] in ("-h", "--help", "--version")
    if is_help and "clearjoint" not in sys.modules and (spec := find_spec("clearjoint")):
        sys.modules["clearjoint"] = module_from_spec(spec)
    from clearjoint._command_line.program import main as program

    signal.signal(signal.SIGINT, previous)
    program()


def _end(number: int, frame: FrameType | None) -> None:
    # End at once: an exception could be caught by the code of a module that is being imported.
    del number, frame
    os.write(2, b"interrupted\n")
    os._exit(130)
