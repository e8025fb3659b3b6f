"""Scenes of one body, hinges, and bearings: what most tests of runs need."""

from collections.abc import Mapping
from typing import Any

import clearjoint as cj

ORIGIN, X, Z = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def one_body(
    name: str,
    joints: Mapping[str, Any] | None = None,
    forces: Mapping[str, Any] | None = None,
    *,
    mass: float = 1.0,
    inertia: Any = (1.0, 1.0, 1.0),
    gravity: Any = None,
    **state: Any,
) -> tuple[cj.Scene, cj.State]:
    """A scene with one body, and its state: the arguments of `body_state`, of which the position is
    the origin unless given."""
    scene = cj.Scene({name: cj.Body(mass, inertia)}, joints or {}, forces or {}, gravity)
    return scene, cj.State({name: cj.body_state(**{"position": ORIGIN, **state})})


def hinge(
    first: str,
    second: str,
    point_first: Any = ORIGIN,
    point_second: Any = ORIGIN,
    axis: Any = Z,
    armature: float | None = None,
) -> cj.RevoluteJoint:
    """A revolute joint about an axis with the same components in both bodies."""
    return cj.RevoluteJoint(first, second, point_first, point_second, axis, axis, armature)


def bearing(
    law: cj.extend.AbstractContactLaw, second: str, first: str = cj.GROUND, **options: Any
) -> cj.ClearanceJoint:
    """A clearance joint about z, with a clearance of 0.5 mm and a journal 20 mm long by default."""
    sizes: dict[str, Any] = {"bearing_radius": 10e-3, "clearance": 0.5e-3, "journal_length": 20e-3}
    return cj.ClearanceJoint(first, second, law=law, **(sizes | options))
