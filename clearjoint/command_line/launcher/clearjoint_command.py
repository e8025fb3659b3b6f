"""The program `clearjoint` from its first moment on.

Installed as a module outside of the package, whose import takes a second or more: Ctrl-C ends the
program during that import as well, without a traceback.
"""

import os
import signal
from types import FrameType


def main() -> None:
    """Run the program with the arguments of the command line."""
    usual = signal.getsignal(signal.SIGINT)
    if usual is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)
    from clearjoint.command_line.program import main as program

    signal.signal(signal.SIGINT, usual)
    program()


def _end(number: int, frame: FrameType | None) -> None:
    del number, frame
    os.write(2, b"interrupted\n")
    os._exit(130)
