"""Suggestions for mistyped names."""

from collections.abc import Iterable
from difflib import get_close_matches

ALIKE = 0.66
"""Similarity of two names, as by `difflib`, from which on one is suggested for the other."""


def nearest(name: object, known: Iterable[str], otherwise: str) -> str:
    """Return the remedy for an unknown name: the most similar known name, regardless of capitals,
    or else the given remedy."""
    by_lower = {other.lower(): other for other in known}
    similar = get_close_matches(str(name).lower(), list(by_lower), n=1, cutoff=ALIKE)
    return f"did you mean {by_lower[similar[0]]!r}? If not, {otherwise}" if similar else otherwise
