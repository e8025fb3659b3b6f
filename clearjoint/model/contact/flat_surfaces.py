"""What laws flat surfaces may have, which know no radii."""

from ...fields.checks import require
from .laws import AbstractContactLaw, AbstractElasticLaw
from .stiffness import GivenStiffness


def require_flat_law(law: object, surfaces: str) -> None:
    """Check that flat surfaces, of a name, can have a law: its stiffness needs no bearing."""
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
            f"{surfaces} are flat, so pass a number in N/m^n as the law's stiffness",
        )
