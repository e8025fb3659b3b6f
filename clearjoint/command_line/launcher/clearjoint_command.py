"""Entry point of the program `clearjoint`.

It is installed as a module outside the package, whose import takes a second or more, so that Ctrl-C
during that import ends the program without a traceback.
"""

import os
import signal
from types import FrameType


def main() -> None:
    """Run the program with the arguments of the command line."""
    previous = signal.getsignal(signal.SIGINT)
    if previous is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)
    from clearjoint.command_line.program import main as program

    signal.signal(signal.SIGINT, previous)
    program()


def _end(number: int, frame: FrameType | None) -> None:
    del number, frame
    os.write(2, b"interrupted\n")
    os._exit(130)
