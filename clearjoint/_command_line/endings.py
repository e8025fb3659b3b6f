"""Messages, errors and exit codes of the program."""

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

import click

if TYPE_CHECKING:
    import xarray as xr

WELL, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
"""Exit codes of the program: success, failed computation, wrong input, and Ctrl-C."""


class CommandResult(NamedTuple):
    """Exit code of a command, its result in one line, whether it wrote results, and the `dataset`
    of a sweep, whose store does not keep the order of the outputs."""

    code: int
    line: str
    wrote: bool = True
    dataset: "xr.Dataset | None" = None


def say(text: str) -> None:
    """Print a message to the error stream; only results go to the standard output."""
    click.echo(text, err=True)


def has_error_stream() -> bool:  # to which a progress bar can be written
    return sys.stderr is not None


@contextmanager
def understandable() -> Iterator[None]:
    """Print warnings and expected errors as sentences, and turn these errors into exit codes.
    Errors of other types, which are faults of the program, keep their tracebacks."""
    with warnings.catch_warnings():
        warnings.showwarning = _say_warning
        try:
            yield
        except (click.exceptions.Exit, BrokenPipeError):  # click handles them
            raise
        except (ValueError, OSError, ImportError, RuntimeError) as error:
            text = str(error)
            # The text of an error of the operating system begins with its number, such as
            # "[Errno 2]": only the file and the description are printed.
            if isinstance(error, OSError) and error.strerror:
                # Some errors, such as that of a full disk, name no file.
                subject = "" if error.filename is None else f"{error.filename}: "
                text = f"{subject}{error.strerror}."
            say(f"error: {text}")
            code = FAILED if isinstance(error, RuntimeError) else BAD_INPUT
            raise click.exceptions.Exit(code) from error
        except KeyboardInterrupt as stop:
            say("interrupted")
            raise click.exceptions.Exit(INTERRUPTED) from stop


def _say_warning(message: Warning | str, *_arguments: object, **_options: object) -> None:
    # Imported here, because help must not import JAX.
    from .._fields.cautions import SILENCE

    say(f"warning: {str(message).split(SILENCE)[0].rstrip()}")  # without the advice for Python
