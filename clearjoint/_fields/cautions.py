"""Warnings about unusual numbers and models, with a class for each kind, so that users can silence
one kind, or turn it into an error."""

import os
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

import equinox as eqx

_FOLDERS = Path(__file__).parents[1], Path(eqx.__file__).parent
_PACKAGES = tuple(f"{folder}{os.sep}" for folder in _FOLDERS)
"""Folders of this package and of Equinox, whose stack frames are not the user's."""
SILENCE = "To silence this:"
"""Start of the last sentence of each warning."""
_QUIET: ContextVar[bool] = ContextVar("quiet", default=False)


_ISSUED = threading.local()
"""`_ISSUED.number` counts the warnings that `caution` has issued in a thread."""


class UnusualValueWarning(UserWarning):
    """Warns that a number is far from its usual range, for example because of a wrong unit.

    >>> import warnings
    >>> warnings.filterwarnings("ignore", category=cj.UnusualValueWarning)  # silence it
    """


class LeftBearingWarning(UserWarning):
    """Warns that a journal has slid out of its bearing along the axis, in a joint that allows it.

    >>> import warnings
    >>> warnings.filterwarnings("error", category=cj.LeftBearingWarning)  # raise it
    """


class NotCarriedOverWarning(UserWarning):
    """Warns that data are left out or replaced: data of an imported file (URDF, MJCF) that a scene
    cannot represent, or data of a scene that an MJCF file cannot represent.

    >>> import warnings
    >>> warnings.filterwarnings("error", category=cj.NotCarriedOverWarning)  # raise it
    """


class PoorFitWarning(UserWarning):
    """Warns that the residuals of a fit are far above the measurements' noise, that the best run of
    a fit fails, or that the test of a fit's covariance has failed.

    >>> import warnings
    >>> warnings.filterwarnings("error", category=cj.PoorFitWarning)  # raise it
    """


class LooseBodyWarning(UserWarning):
    """Warns that no joint or force acts on a body of a scene with joints, or that no joint holds
    the axis about which a drive rotates a body.

    >>> import warnings
    >>> warnings.filterwarnings("ignore", category=cj.LooseBodyWarning)  # silence it
    """


class LawRangeWarning(UserWarning):
    """Warns that a contact or film law is used outside the range for which it holds, or does not
    deliver the restitution that is requested.

    >>> import warnings
    >>> warnings.filterwarnings("error", category=cj.LawRangeWarning)  # raise it
    """


def caution(message: str, category: type[Warning]) -> None:
    """Issue a warning that points to the user's line of code, with a sentence on how to silence it;
    do nothing within the context `quiet`."""
    if not warns():
        return
    _ISSUED.number = number_issued() + 1
    silence = f'warnings.filterwarnings("ignore", category=clearjoint.{category.__name__})'
    warnings.warn(f"{message} {SILENCE} {silence}.", category, level_of_the_user())


def warn_the_user(message: str) -> None:
    """Issue a `UserWarning` that points to the user's line of code."""
    warnings.warn(message, stacklevel=level_of_the_user())


def number_issued() -> int:
    return getattr(_ISSUED, "number", 0)


def warns() -> bool:
    return not _QUIET.get()


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress the warnings of `caution` within the context."""
    token = _QUIET.set(True)
    try:
        yield
    finally:
        _QUIET.reset(token)


def level_of_the_user() -> int:
    """Return the `stacklevel` with which a warning of the caller refers to the innermost stack
    frame outside of this package and Equinox."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGES):
        level, frame = level + 1, frame.f_back
    return level
