"""Coefficients of restitution of rigid contacts: one given value for all contacts, or for each
contact the value that its law delivers in a free impact."""

from ...fields.checks import require, require_range
from ...math.vectors import Scalar
from ...model.joints.base import each_label
from ...model.scene import Scene


def require_restitution(scene: Scene, restitution: Scalar | None) -> None:
    """Check that every contact has a coefficient of restitution: the given number or, for ``None``,
    that of its law.

    **Raises:** `ValueError` for a number outside 0 to 1; without a number, for a contact law
    without a method `delivered_restitution`.
    """
    if restitution is not None:
        require_range("restitution", restitution, 0.0, 1.0, "1 is elastic, 0 is plastic")
        return
    for name, family in scene.laws().items():
        for label, law in family.items():
            fine, given = hasattr(law, "delivered_restitution"), type(law).__name__
            expected = f"of a law with delivered_restitution() at {label!r}"
            remedy = "pass restitution=, or give the law such a method"
            require(fine, f"scene.joints[{name!r}]", given, expected, remedy)


def restitutions(scene: Scene, restitution: Scalar | None) -> dict[str, dict[str, Scalar]]:
    """Return Newton's coefficient of restitution of each contact, as restitutions[joint][contact].

    **Arguments:** `restitution`: the coefficient of all contacts, or ``None`` for the coefficients
    that the contact laws report, from the rebound of a free impact.
    """
    laws = scene.laws()
    if restitution is not None:
        return each_label(lambda name, label: restitution, laws)
    return each_label(lambda name, label: laws[name][label].delivered_restitution(), laws)  # pyright: ignore
