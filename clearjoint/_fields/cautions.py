"""Warnings about unusual numbers, bodies that nothing holds, contents of files that are not read,
poor fits, and runs that leave the range of a model's validity.

The subclasses of `UserWarning` let users silence one kind, or turn it into an error.
"""

import os
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

import equinox as eqx

_PACKAGES = tuple(
    f"{folder}{os.sep}" for folder in (Path(__file__).parents[1], Path(eqx.__file__).parent)
)
"""Folders of this package and of Equinox. Stack frames of code in them are not the user's."""
SILENCE = "To silence this:"
"""Start of the last sentence of each warning, on how to silence it."""
_QUIET: ContextVar[bool] = ContextVar("quiet", default=False)


class _Issued(threading.local):
    """Number of warnings that `caution` has issued in each thread."""

    number = 0


_ISSUED = _Issued()


class UnusualValueWarning(UserWarning):
    """Warns that a number is far from its usual range, for example because of a wrong unit.

    Silence it with ``warnings.filterwarnings("ignore", category=clearjoint.UnusualValueWarning)``.

    >>> import warnings
    >>> with warnings.catch_warnings(record=True) as seen:
    ...     warnings.simplefilter("always")
    ...     _ = cj.laws.RavnStiffness(207.0, 0.3)  # GPa?
    >>> print(str(seen[-1].message)[:66])
    Argument `young_modulus` is 207 Pa, where at least 1e+09 Pa is usu
    """


class LeftBearingWarning(UserWarning):
    """Warns that a journal has slid out of its bearing along the axis, in a joint that allows it.

    Silence it with ``warnings.filterwarnings("ignore", category=clearjoint.LeftBearingWarning)``.

    >>> import warnings
    >>> warnings.filterwarnings("error", category=cj.LeftBearingWarning)  # raise it
    """


class NotCarriedOverWarning(UserWarning):
    """Warns that an imported file (URDF) contains data that a scene cannot represent, and that are
    left out or replaced.

    Silence it with ``warnings.filterwarnings("ignore",
    category=clearjoint.NotCarriedOverWarning)``.

    >>> import warnings
    >>> warnings.filterwarnings("error", category=cj.NotCarriedOverWarning)  # raise it
    """


class PoorFitWarning(UserWarning):
    """Warns that the residuals of a fit are far above the measurements' noise, that the best run of
    a fit fails, or that the test of a fit's covariance has failed.

    Silence it with ``warnings.filterwarnings("ignore", category=clearjoint.PoorFitWarning)``.

    >>> import warnings
    >>> warnings.filterwarnings("error", category=cj.PoorFitWarning)  # raise it
    """


class LooseBodyWarning(UserWarning):
    """Warns that no joint or force acts on a body, or that no joint holds the axis about which a
    drive rotates a body.

    Silence it with ``warnings.filterwarnings("ignore", category=clearjoint.LooseBodyWarning)``.

    >>> import warnings
    >>> with warnings.catch_warnings(record=True) as seen:
    ...     warnings.simplefilter("always")
    ...     body = cj.Body(1.0, (1e-3, 1e-3, 1e-3))
    ...     weld = cj.FixedJoint("ground", "arm", (0, 0, 0), (0, 0, 0))
    ...     _ = cj.Scene({"arm": body, "ball": body}, {"weld": weld})
    >>> print(str(seen[-1].message)[:41])
    No joint and no force acts on body 'ball'
    """


class LawRangeWarning(UserWarning):
    """Warns that a contact or film law is used outside the range for which it holds, or does not
    deliver the restitution that is requested.

    Silence it with ``warnings.filterwarnings("ignore", category=clearjoint.LawRangeWarning)``.

    >>> import warnings
    >>> warnings.filterwarnings("error", category=cj.LawRangeWarning)  # raise it
    """


def caution(message: str, category: type[Warning]) -> None:
    """Issue a warning that points to the user's line of code, not to a line of this package.

    A sentence on how to silence the warning is added to `message`. Within the context `quiet`, no
    warning is issued.

    **Arguments:** `category`: one of the classes of this module.
    """
    if not warns():
        return
    _ISSUED.number += 1
    silence = f'warnings.filterwarnings("ignore", category=clearjoint.{category.__name__})'
    warnings.warn(f"{message} {SILENCE} {silence}.", category, level_of_the_user())


def number_issued() -> int:
    """Return the number of warnings that `caution` has issued in this thread."""
    return _ISSUED.number


def warns() -> bool:
    """Return whether `caution` issues warnings: false within the context `quiet`."""
    return not _QUIET.get()


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress the warnings of this module within the context.

    Use it where checks are repeated for numbers about which the user has been warned before, and
    where numbers are unusual on purpose.
    """
    token = _QUIET.set(True)
    try:
        yield
    finally:
        _QUIET.reset(token)


def level_of_the_user() -> int:
    """Return the `stacklevel` for `warnings.warn` with which a warning refers to the user's code.

    The user's code is the innermost stack frame outside of this package and Equinox. The function
    that calls this one must also call `warnings.warn`, since levels are counted from that function.
    """
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGES):
        level, frame = level + 1, frame.f_back
    return level
