"""Messages, errors and exit codes of the program."""

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple, NoReturn

import click

from ..fields.cautions import SILENCE

WELL, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
"""Exit codes of the program: success, failed computation, wrong input, and Ctrl-C."""


class CommandResult(NamedTuple):
    """Result of a command.

    - `code`: exit code.
    - `line`: result in one line of text.
    """

    code: int
    line: str


def say(text: str) -> None:
    """Print a message to the error stream, which results don't use."""
    click.echo(text, err=True)


def end(code: int) -> NoReturn:
    """End the command with an exit code."""
    raise click.exceptions.Exit(code)


@contextmanager
def understandable() -> Iterator[None]:
    """Return a context that prints an error as one sentence and ends the program with an exit code,
    and prints each warning as one line."""
    with warnings.catch_warnings():
        warnings.showwarning = _say_warning
        try:
            yield
        except click.exceptions.Exit:
            raise
        except (ValueError, OSError, ImportError, RuntimeError) as error:
            text = str(error)
            if isinstance(error, OSError) and error.strerror:
                text = f"{error.filename}: {error.strerror}."
            say(f"error: {text}")
            end(BAD_INPUT if isinstance(error, ValueError | OSError | ImportError) else FAILED)
        except KeyboardInterrupt:
            say("interrupted")
            end(INTERRUPTED)


def _say_warning(message: Warning | str, *_arguments: object, **_options: object) -> None:
    say(f"warning: {str(message).split(SILENCE)[0].rstrip()}")  # without the advice for Python


def shows_progress() -> bool:
    """Return whether the process has an error stream, to which a progress bar can be written."""
    return sys.stderr is not None
