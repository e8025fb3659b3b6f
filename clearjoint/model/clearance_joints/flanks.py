"""What plays that end at two flanks share: the flanks' names, and their sides."""

from .journal_bases import SIDES

FLANKS = ("lower flank", "upper flank")
"""Where the play ends: against the positive sense of turning, and along it."""
SIDE_OF: dict[str, float] = dict(zip(FLANKS, SIDES, strict=True))
