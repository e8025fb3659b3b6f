"""What a mistyped name was meant to be."""

from collections.abc import Iterable
from difflib import get_close_matches

ALIKE = 0.66
"""Share of letters in common, of both names, from which one may be meant for the other."""


def nearest(name: object, known: Iterable[str], otherwise: str) -> str:
    """The remedy for a name that is not among the known ones, whatever its capitals: the one most
    like it, or else what to do otherwise."""
    by_letters = {one.lower(): one for one in known}
    meant = get_close_matches(str(name).lower(), list(by_letters), n=1, cutoff=ALIKE)
    return f"did you mean {by_letters[meant[0]]!r}? If not, {otherwise}" if meant else otherwise
