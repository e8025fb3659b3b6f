"""The trees that a scene's ideal joints make of its bodies. Found from names, while tracing."""

from collections.abc import Iterator

from ...model.bodies import GROUND
from ...model.joints.base import AbstractConstraint
from ...model.scene import Scene
from ..coordinates import anchors
from .branches import AbstractBranch, FreeBranch, JointedBranch

Tree = list[AbstractBranch]
"""Branches in an order in which each parent comes before its children. Only the first, the root,
stands on the ground."""


def forest(scene: Scene) -> list[Tree]:
    """The trees of a scene, independent of each other but for closed loops.

    What joints connect to the ground comes first, near bodies before far ones, so that chains are
    short. Of those that hang together without being carried, one moves freely: one with an anchor
    if there is any, since it keeps its digits so.
    """
    placed = {GROUND}
    trees = [[root, *_grown(scene, root.body, placed)] for root in _next(scene, GROUND, placed)]
    points = anchors(scene)
    for name in sorted(scene.bodies, key=lambda name: name not in points):
        if name not in placed:
            placed.add(name)
            root = FreeBranch(name, GROUND, points.get(name))
            trees.append([root, *_grown(scene, name, placed)])
    return trees


def _grown(scene: Scene, start: str, placed: set[str]) -> Tree:
    """What hangs on a placed body, the nearest first."""
    grown: Tree = []
    waiting = [start]
    while waiting:
        found = _next(scene, waiting.pop(0), placed)
        grown += found
        waiting += [branch.body for branch in found]
    return grown


def _next(scene: Scene, parent: str, placed: set[str]) -> Tree:
    """The bodies that joints carry on a placed body; adds them to the placed ones."""
    found: Tree = []
    for branch in _possible(scene, parent):
        if branch.body not in placed:
            placed.add(branch.body)
            found.append(branch)
    return found


def _possible(scene: Scene, parent: str) -> Iterator[JointedBranch]:
    for name, joint in scene.joints.items():
        if isinstance(joint, AbstractConstraint):
            bodies = joint.body_names()
            if len(bodies) == 2 and parent in bodies:
                body = bodies[1] if parent == bodies[0] else bodies[0]
                freedom = joint.freedom(parent)
                if freedom is not None:
                    yield JointedBranch(body, parent, name, freedom)
