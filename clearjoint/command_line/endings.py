"""How the program ends: what it says of what went wrong, and its exit codes."""

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

import click

WELL, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
"""Exit codes."""


def say(text: str) -> None:
    """Tell the user something that is no result: it goes to the error stream."""
    click.echo(text, err=True)


def end(code: int) -> NoReturn:
    """End the command with an exit code."""
    raise click.exceptions.Exit(code)


@contextmanager
def understandable() -> Iterator[None]:
    """Inside, errors become a sentence and an exit code, and warnings a line each."""
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_args, **_options: say(f"warning: {message}")
        try:
            yield
        except click.exceptions.Exit:
            raise
        except (ValueError, OSError, ImportError, RuntimeError) as error:
            say(f"error: {_sentence(error)}")
            end(BAD_INPUT if isinstance(error, ValueError | OSError | ImportError) else FAILED)
        except KeyboardInterrupt:
            say("interrupted")
            end(INTERRUPTED)


def _sentence(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}."
    return str(error)


def shows_progress() -> bool:
    """Whether there is an error stream, on which progress is shown."""
    return sys.stderr is not None
