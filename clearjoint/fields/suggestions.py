"""Suggestions for mistyped names."""

from collections.abc import Iterable
from difflib import get_close_matches

ALIKE = 0.66
"""Smallest similarity of an unknown and a known name, from 0 to 1 by `difflib`, at which an error
message suggests the known one."""


def nearest(name: object, known: Iterable[str], otherwise: str) -> str:
    """Return the remedy for an unknown name, as the end of an error message.

    It suggests the most similar of the `known` names, without regard to capitals, followed by the
    advice `otherwise`. If no name is similar, it is `otherwise` alone.
    """
    by_lower = {other.lower(): other for other in known}
    similar = get_close_matches(str(name).lower(), list(by_lower), n=1, cutoff=ALIKE)
    return f"did you mean {by_lower[similar[0]]!r}? If not, {otherwise}" if similar else otherwise
