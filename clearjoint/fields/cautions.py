"""Warnings about unusual numbers, and about runs that leave the range of a model."""

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

import equinox as eqx

_PACKAGES = str(Path(__file__).parents[1]), str(Path(eqx.__file__).parent)
SILENCE = "To silence this:"
"""Start of the advice on silencing that follows a warning."""
_QUIET: ContextVar[bool] = ContextVar("quiet", default=False)


class UnusualValueWarning(UserWarning):
    """A number is far from the usual range: its unit may be wrong.

    Silence it with ``warnings.filterwarnings("ignore", category=clearjoint.UnusualValueWarning)``.

    >>> import warnings
    >>> with warnings.catch_warnings(record=True) as seen:
    ...     warnings.simplefilter("always")
    ...     _ = cj.laws.RavnStiffness(207.0, 0.3)  # GPa?
    >>> print(str(seen[-1].message)[:66])
    Argument `young_modulus` is 207 Pa, where at least 1e+09 Pa is usu
    """


class LeftBearingWarning(UserWarning):
    """A journal that is not held axially has slid out of its bearing.

    Silence it with ``warnings.filterwarnings("ignore", category=clearjoint.LeftBearingWarning)``.

    >>> import warnings
    >>> warnings.filterwarnings("error", category=cj.LeftBearingWarning)  # raise it
    """


class NotCarriedOverWarning(UserWarning):
    """A file contains data that a scene cannot represent.

    Silence it with
    ``warnings.filterwarnings("ignore", category=clearjoint.NotCarriedOverWarning)``.

    >>> import warnings
    >>> warnings.filterwarnings("error", category=cj.NotCarriedOverWarning)  # raise it
    """


class PoorFitWarning(UserWarning):
    """The residual of a fit is far above the noise.

    Silence it with ``warnings.filterwarnings("ignore", category=clearjoint.PoorFitWarning)``.

    >>> import warnings
    >>> warnings.filterwarnings("error", category=cj.PoorFitWarning)  # raise it
    """


class LooseBodyWarning(UserWarning):
    """A body, or the axis of a drive, is not held by anything.

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
    """A contact law is used outside of its range, or for a result that it cannot provide.

    Silence it with ``warnings.filterwarnings("ignore", category=clearjoint.LawRangeWarning)``.

    >>> import warnings
    >>> warnings.filterwarnings("error", category=cj.LawRangeWarning)  # raise it
    """


def caution(message: str, category: type[Warning]) -> None:
    """Warn at the user's line of code, with advice on how to silence the warning."""
    if not warns():
        return
    silence = f'warnings.filterwarnings("ignore", category=clearjoint.{category.__name__})'
    warnings.warn(f"{message} {SILENCE} {silence}.", category, _level_of_the_user())


def warns() -> bool:
    """Return whether cautions are issued; not within `quiet`."""
    return not _QUIET.get()


@contextmanager
def quiet() -> Iterator[None]:
    """Issue no cautions within the context, in which numbers are checked again."""
    token = _QUIET.set(True)
    try:
        yield
    finally:
        _QUIET.reset(token)


def _level_of_the_user() -> int:
    """Return the stack level, for `warnings.warn` in the caller, of the first frame that is neither
    in this package nor in equinox."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGES):
        level, frame = level + 1, frame.f_back
    return level
