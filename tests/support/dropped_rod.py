"""A level rod held at one end by a pin with clearance, let go with the journal centred."""

from typing import Any

import clearjoint as cj
from tests.support.one_body import bearing, one_body

STEEL = cj.laws.RavnStiffness(207e9, 0.3)


def dropped_rod(
    law: cj.extend.AbstractContactLaw | None = None, **options: Any
) -> tuple[cj.Scene, cj.State]:
    """The scene and its state at rest; the journal falls along Y and strikes the bearing twice
    before 0.03 s, unless with another law or other options of the joint."""
    law = law or cj.laws.LankaraniNikravesh(0.9, STEEL)
    pin = bearing(law, "rod", journal_point=(-0.5, 0.0, 0.0), **options)
    body = {"mass": 7.02, "inertia": (0.1, 0.5855, 0.5855), "position": (0.5, 0.0, 0.0)}
    return one_body("rod", {"pin": pin}, gravity=(0.0, 9.81, 0.0), **body)
