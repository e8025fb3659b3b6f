"""Whether the laws of a run's contacts hold for the penetrations that came."""

from ..model.contact.limits import exceeded
from ..model.scene import Scene
from .impact_table import Impacts


def beyond_law_ranges(scene: Scene, impacts: Impacts) -> list[str]:
    """Sentences on impacts deeper than their contacts' laws hold for, none if all are within.

    Each names joint, contact, law, quantity, limits and the largest value.
    """
    sentences = []
    for name, joint in scene.contact_joints().items():
        for label in joint.laws():
            depths = impacts.of(name, label).largest_penetration
            if len(depths):
                limits = joint.law_limits(label, float(depths.max()))
                where = f"Contact {label!r} of joint {name!r}: "
                sentences += [where + text for text in exceeded(limits, "penetration")]
    return sentences
