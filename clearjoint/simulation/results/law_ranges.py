"""Check whether contacts of a run were deeper than the ranges of validity of their laws."""

from ...model.contact.gap import exceeded
from ...model.scene import Scene
from .impact_table import Impacts


def beyond_law_ranges(scene: Scene, impacts: Impacts) -> list[str]:
    """Return sentences on the contacts that were deeper than their laws are valid for.

    A sentence names the joint, the contact, the law, the limit of the penetration in the law's
    range of validity, and the largest penetration of the contact.

    **Arguments:** `scene`: the scene that was simulated; `impacts`: the table of its impacts.

    **Returns:** the sentences; an empty list if all contacts stayed within the ranges.

    >>> cylinder = cj.laws.JohnsonCylinder(207e9, 0.3, length=10e-3)
    >>> scene, _ = cj.mechanisms.double_pendulum(law=cj.laws.Hertz(cylinder))
    >>> names = np.array(["shoulder"]), np.array(["V"])
    >>> depth = np.array([0.4e-3])  # of 0.5 mm of clearance
    >>> impacts = cj.results.Impacts(*names, *[np.zeros(1)] * 7, depth)
    >>> print(cj.beyond_law_ranges(scene, impacts)[0][:66])
    Contact 'V' of joint 'shoulder': `JohnsonCylinder` holds for a pen
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
