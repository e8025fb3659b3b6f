"""The trees that a scene's ideal joints make of its bodies. Found from names, while tracing."""

from collections.abc import Iterator
from typing import TypeAlias

from ...model.bodies import GROUND
from ...model.joints.base import AbstractConstraint
from ...model.scene import Scene
from ..coordinates import anchors
from .branches import AbstractBranch, FreeBranch, JointedBranch

Tree: TypeAlias = list[AbstractBranch]
"""Branches in an order in which each parent comes before its children. Only the first, the root,
stands on the ground."""


def forest(scene: Scene) -> list[Tree]:
    """The trees of a scene, independent of each other but for closed loops.

    What joints connect to the ground comes first, near bodies before far ones, so that chains are
    short. Of those that hang together without being carried, one moves freely: one with an anchor
    if there is any, since it keeps its digits so.
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
    """What hangs on a placed body, the nearest first."""
    descendants: Tree = []
    waiting = [start]
    while waiting:
        children = _children(scene, waiting.pop(0), placed)
        descendants += children
        waiting += [branch.body for branch in children]
    return descendants


def _children(scene: Scene, parent: str, placed: set[str]) -> Tree:
    """The bodies that joints carry on a placed body; adds them to the placed ones."""
    children: Tree = []
    for branch in _carried(scene, parent):
        if branch.body not in placed:
            placed.add(branch.body)
            children.append(branch)
    return children


def _carried(scene: Scene, parent: str) -> Iterator[JointedBranch]:
    """A branch for each joint that can carry another body on the parent."""
    for name, joint in scene.joints.items():
        if isinstance(joint, AbstractConstraint):
            bodies = joint.body_names()
            if len(bodies) == 2 and parent in bodies:
                body = bodies[1] if parent == bodies[0] else bodies[0]
                motion_subspace = joint.motion_subspace(parent)
                if motion_subspace is not None:
                    yield JointedBranch(body, parent, name, motion_subspace)
