"""Spanning trees of a scene's bodies and ideal joints, found from names while JAX traces."""

from collections.abc import Iterator
from typing import TypeAlias

from ...model.bodies import GROUND
from ...model.joints.base import AbstractConstraint
from ...model.scene import Scene
from ..coordinates import anchors
from .branches import AbstractBranch, FreeBranch, JointedBranch

Tree: TypeAlias = list[AbstractBranch]
"""List of branches, each parent before its children. The first branch is the root; only its parent
is the ground."""


def forest(scene: Scene) -> list[Tree]:
    """Return the trees of a scene; only constraints that close loops couple different trees.

    Bodies that ideal joints connect to the ground come first. Bodies are visited breadth first, so
    that chains are short. Of connected bodies without a joint to the ground, one becomes a free
    root. A body with an `Anchor` is preferred as root, since the anchor preserves digits of its
    position.
    """
    placed = {GROUND}
    trees = [
        [root, *_descendants(scene, root.body, placed)] for root in _children(scene, GROUND, placed)
    ]
    points = anchors(scene)
    for name in sorted(scene.bodies, key=lambda name: name not in points):
        if name not in placed:
            placed.add(name)
            root = FreeBranch(name, GROUND, points.get(name))
            trees.append([root, *_descendants(scene, name, placed)])
    return trees


def _descendants(scene: Scene, start: str, placed: set[str]) -> Tree:
    """Return the branches below the body `start`, breadth first, and add their bodies to
    `placed`."""
    descendants: Tree = []
    waiting = [start]
    while waiting:
        children = _children(scene, waiting.pop(0), placed)
        descendants += children
        waiting += [branch.body for branch in children]
    return descendants


def _children(scene: Scene, parent: str, placed: set[str]) -> Tree:
    """Return the branches on the body `parent`, and add their bodies to `placed`.

    Bodies already in `placed` are left out.
    """
    children: Tree = []
    for branch in _carried(scene, parent):
        if branch.body not in placed:
            placed.add(branch.body)
            children.append(branch)
    return children


def _carried(scene: Scene, parent: str) -> Iterator[JointedBranch]:
    """Yield a branch for each ideal joint that can carry another body on the body `parent`."""
    for name, joint in scene.joints.items():
        if isinstance(joint, AbstractConstraint):
            bodies = joint.body_names()
            if len(bodies) == 2 and parent in bodies:
                body = bodies[1] if parent == bodies[0] else bodies[0]
                motion_subspace = joint.motion_subspace(parent)
                if motion_subspace is not None:
                    yield JointedBranch(body, parent, name, motion_subspace)
