"""Joint coordinates: angles and distances of the ideal joints, which then need no constraints.

A clearance joint is a force element: it opens its loop. What is left of most mechanisms with
clearances is a tree, and in joint coordinates a tree has no multipliers, no drift, no redundancy
and few states. Joints that close a loop stay constraints.
"""

from collections.abc import Iterator
from typing import TypeAlias

from ...math.rotations import rotation_matrix
from ...math.vectors import Scalar, add
from ...model.bodies import GROUND, GROUND_MOTION, BodyState, Motion
from ...model.joints.base import Motions, Row
from ...model.scene import Scene
from ..coordinates import (
    AbstractCoordinates,
    AbstractMechanics,
    BodyAcceleration,
    MotionVariables,
    Speeds,
    Wrenches,
)
from .branches import UPRIGHT, AbstractBranch, JointedBranch
from .composite_rigid_body import TreeMechanics
from .tree import forest

TreeVariables: TypeAlias = dict[str, MotionVariables]
"""A `JointState` for each body that a joint carries, a `BodyState` for each free one."""


class JointCoordinates(AbstractCoordinates):
    """Relative positions and speeds of the bodies along the ideal joints that carry them.

    A body that nothing carries has the variables that it has in absolute coordinates, those of its
    `Anchor` included.

    The default, since they are the faster ones on every mechanism measured. Time of a right-hand
    side in a native loop of one lane, in joint and in absolute coordinates, µs: double pendulum
    0.14 and 0.24 (0.04 and 0.07 a lane in a batch of 64), ideal one 0.03 and 0.38, double four-bar
    0.25 and 50, Bricard 0.5 and 45, chain of 4 and of 12 bodies about changing axes 0.2 and 34, 2.3
    and 150. The large ratios are those of systems of constraints that no longer need LAPACK.

    >>> cj.Settings(coordinates=cj.JointCoordinates()).coordinates
    JointCoordinates()
    """

    def eliminated(self, scene: Scene) -> frozenset[str]:
        """The joints that carry a body of a tree."""
        return frozenset(
            branch.joint for branch in _branches(scene) if isinstance(branch, JointedBranch)
        )

    def encode(self, scene: Scene, bodies: dict[str, BodyState]) -> TreeVariables:
        """The variables of a state. What violates a joint of the trees is lost."""
        poses = {GROUND: (UPRIGHT, GROUND_MOTION)}
        for name, body in bodies.items():
            rotation = rotation_matrix(body.orientation)
            poses[name] = (
                body.orientation,
                Motion(body.position, rotation, body.velocity, body.spin),
            )
        return {
            branch.body: branch.encode(poses[branch.parent], poses[branch.body])
            for branch in _branches(scene)
        }

    def decode(self, scene: Scene, variables: TreeVariables) -> dict[str, BodyState]:
        """The states of the bodies."""
        motions, turns = self.motions(scene, variables), {GROUND: UPRIGHT}
        for branch in _branches(scene):
            state = variables[branch.body]
            turns[branch.body] = branch.orientation(turns[branch.parent], state)
        return {
            name: BodyState(
                motions[name].position, turns[name], motions[name].velocity, motions[name].spin
            )
            for name in scene.bodies
        }

    def motions(self, scene: Scene, variables: TreeVariables) -> Motions:
        """Motion of each body, from the roots to the leaves."""
        motions: dict[str, Motion] = {GROUND: GROUND_MOTION}
        for branch in _branches(scene):
            motions[branch.body] = branch.motion(motions[branch.parent], variables[branch.body])
        return motions

    def mechanics(self, scene: Scene, variables: TreeVariables) -> "JointMechanics":
        """The equations of motion of the trees."""
        return JointMechanics(scene, variables, self.motions(scene, variables))

    def without_drift(self, scene: Scene, variables: TreeVariables) -> TreeVariables:
        """The variables of each body, in numbers that don't drift."""
        return {
            branch.body: branch.without_drift(variables[branch.body]) for branch in _branches(scene)
        }

    def with_speeds(
        self, scene: Scene, variables: TreeVariables, others: TreeVariables
    ) -> TreeVariables:
        """The variables of each body with the speeds of the others."""
        return {
            branch.body: branch.with_speeds(variables[branch.body], others[branch.body])
            for branch in _branches(scene)
        }


def _branches(scene: Scene) -> list[AbstractBranch]:
    return [branch for tree in forest(scene) for branch in tree]


class JointMechanics(AbstractMechanics):
    """The trees side by side."""

    def __init__(self, scene: Scene, variables: TreeVariables, motions: Motions):
        self.motions = motions
        self._trees = [TreeMechanics(scene, tree, variables, motions) for tree in forest(scene)]

    def _shared_out(self, numbers: Speeds) -> Iterator[tuple[TreeMechanics, Speeds]]:
        first = 0
        for tree in self._trees:
            yield tree, numbers[first : first + tree.size]
            first += tree.size

    def free_rates(self, wrenches: Wrenches) -> Speeds:
        """Rates of the speeds of all trees."""
        return [rate for tree in self._trees for rate in tree.free_rates(wrenches)]

    def projected(self, wrenches: Wrenches) -> Speeds:
        """Forces on the speeds of all trees."""
        return [force for tree in self._trees for force in tree.projected(wrenches)]

    def solved(self, forces: Speeds) -> Speeds:
        """By the factorised mass matrix of each tree."""
        return [rate for tree, part in self._shared_out(forces) for rate in tree.solved(part)]

    def bias(self, row: Row) -> Scalar:
        """The sum over all trees."""
        total: Scalar = 0.0
        for tree in self._trees:
            total = add(total, tree.bias(row))
        return total

    def accelerations(self, rates: Speeds) -> dict[str, BodyAcceleration]:
        """Accelerations of the bodies of all trees."""
        parts = [tree.accelerations(part) for tree, part in self._shared_out(rates)]
        return {name: body for part in parts for name, body in part.items()}

    def variable_rates(self, rates: Speeds) -> TreeVariables:
        """Rates of the variables of all trees."""
        parts = [tree.variable_rates(part) for tree, part in self._shared_out(rates)]
        return {name: body for part in parts for name, body in part.items()}

    def after_displacement(self, changes: Speeds) -> TreeVariables:
        """The variables of all trees after a small motion along their speeds."""
        parts = [tree.after_displacement(part) for tree, part in self._shared_out(changes)]
        return {name: body for part in parts for name, body in part.items()}

    def after_speed_change(self, changes: Speeds) -> TreeVariables:
        """The variables of all trees after changes of their speeds."""
        parts = [tree.after_speed_change(part) for tree, part in self._shared_out(changes)]
        return {name: body for part in parts for name, body in part.items()}
