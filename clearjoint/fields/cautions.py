"""Warnings about unusual numbers, and about runs that leave the range of a model's validity."""

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

import equinox as eqx

_PACKAGES = str(Path(__file__).parents[1]), str(Path(eqx.__file__).parent)
SILENCE = "To silence this:"
"""Start of the last sentence of each warning, on how to silence it."""
_QUIET: ContextVar[bool] = ContextVar("quiet", default=False)


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
    """Warns that a journal that nothing holds axially has slid out of its bearing.

    Silence it with ``warnings.filterwarnings("ignore", category=clearjoint.LeftBearingWarning)``.

    >>> import warnings
    >>> warnings.filterwarnings("error", category=cj.LeftBearingWarning)  # raise it
    """


class NotCarriedOverWarning(UserWarning):
    """Warns that a file that is read contains data that a scene cannot represent.

    Silence it with ``warnings.filterwarnings("ignore",
    category=clearjoint.NotCarriedOverWarning)``.

    >>> import warnings
    >>> warnings.filterwarnings("error", category=cj.NotCarriedOverWarning)  # raise it
    """


class PoorFitWarning(UserWarning):
    """Warns that the residuals of a fit are far above the measurements' noise.

    Silence it with ``warnings.filterwarnings("ignore", category=clearjoint.PoorFitWarning)``.

    >>> import warnings
    >>> warnings.filterwarnings("error", category=cj.PoorFitWarning)  # raise it
    """


class LooseBodyWarning(UserWarning):
    """Warns that nothing holds a body or the axis of a drive.

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
    """Warns that a contact law is used outside of its range, or for a result that it cannot
    provide.

    Silence it with ``warnings.filterwarnings("ignore", category=clearjoint.LawRangeWarning)``.

    >>> import warnings
    >>> warnings.filterwarnings("error", category=cj.LawRangeWarning)  # raise it
    """


def caution(message: str, category: type[Warning]) -> None:
    """Issue a warning of a category of this module at the user's line of code.

    A sentence on how to silence the warning is added to `message`. Within `quiet`, nothing is
    issued.
    """
    if not warns():
        return
    silence = f'warnings.filterwarnings("ignore", category=clearjoint.{category.__name__})'
    warnings.warn(f"{message} {SILENCE} {silence}.", category, _level_of_the_user())


def warns() -> bool:
    """Return whether warnings are issued: not within `quiet`."""
    return not _QUIET.get()


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress the warnings of this module within the context, for numbers that were checked
    before."""
    token = _QUIET.set(True)
    try:
        yield
    finally:
        _QUIET.reset(token)


def _level_of_the_user() -> int:
    """Return the `stacklevel` with which `warnings.warn`, called by the caller of this function,
    points at the first frame outside of this package and equinox."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGES):
        level, frame = level + 1, frame.f_back
    return level
