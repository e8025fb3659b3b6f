"""What plays that end at two flanks share: the flanks' names, and what laws they may have."""

from ...fields.checks import require
from ..contact.laws import AbstractContactLaw, AbstractElasticLaw
from ..contact.stiffness import GivenStiffness
from .journal_bases import SIDES

FLANKS = ("lower flank", "upper flank")
"""Where the play ends: against the positive sense of turning, and along it."""
SIDE_OF: dict[str, float] = dict(zip(FLANKS, SIDES, strict=True))


def require_flat_law(law: object) -> None:
    """Check that flanks can have a law: one without bearing or journal."""
    require(
        isinstance(law, AbstractContactLaw),
        "law",
        law,
        "an AbstractContactLaw",
        "pass a law such as HuntCrossley(0.5, 1e8)",
    )
    if isinstance(law, AbstractElasticLaw):
        require(
            isinstance(law.stiffness, GivenStiffness),
            "law",
            type(law.stiffness).__name__,
            "a law with a given stiffness",
            "flanks have no bearing's radius: pass a number in N/m^n as the law's stiffness",
        )
