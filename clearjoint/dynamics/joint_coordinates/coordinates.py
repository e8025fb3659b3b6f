"""Joint coordinates: angles and distances of the ideal joints, which then need no constraints.

A clearance joint is a force element and opens its loop, so most mechanisms with clearances are
trees. In joint coordinates a tree has no multipliers, no drift, no redundancy and few states.
Joints that close a loop remain constraints.
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

    A free body has the same variables as in absolute coordinates, including its `Anchor`.

    They are the default, because they are faster on every mechanism measured. Time of a right-hand
    side in a native loop of one lane, µs:

    | mechanism | joint coordinates | absolute coordinates |
    |---|---|---|
    | double pendulum with clearance | 0.14 | 0.24 |
    | the same, a lane in a batch of 64 | 0.04 | 0.07 |
    | ideal double pendulum | 0.03 | 0.38 |
    | double four-bar | 0.25 | 50 |
    | Bricard | 0.5 | 45 |
    | chain of 4 bodies, changing axes | 0.2 | 34 |
    | chain of 12 bodies, changing axes | 2.3 | 150 |

    The large ratios are due to systems of constraints that then need no LAPACK.

    >>> cj.Settings(coordinates=cj.JointCoordinates()).coordinates
    JointCoordinates()
    """

    def eliminated(self, scene: Scene) -> frozenset[str]:
        """Return the names of the joints that carry a body of a tree."""
        return frozenset(
            branch.joint for branch in _branches(scene) if isinstance(branch, JointedBranch)
        )

    def encode(self, scene: Scene, bodies: dict[str, BodyState]) -> TreeVariables:
        """Return the variables of a state; violations of the joints of the trees are dropped."""
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
        """Return the states of the bodies."""
        motions, orientations = self.motions(scene, variables), {GROUND: UPRIGHT}
        for branch in _branches(scene):
            state = variables[branch.body]
            orientations[branch.body] = branch.orientation(orientations[branch.parent], state)
        return {
            name: BodyState(
                motions[name].position,
                orientations[name],
                motions[name].velocity,
                motions[name].spin,
            )
            for name in scene.bodies
        }

    def motions(self, scene: Scene, variables: TreeVariables) -> Motions:
        """Return the motion of each body, from the roots to the leaves."""
        motions: dict[str, Motion] = {GROUND: GROUND_MOTION}
        for branch in _branches(scene):
            motions[branch.body] = branch.motion(motions[branch.parent], variables[branch.body])
        return motions

    def mechanics(self, scene: Scene, variables: TreeVariables) -> "JointMechanics":
        """Return the equations of motion of the trees."""
        return JointMechanics(scene, variables, self.motions(scene, variables))

    def without_drift(self, scene: Scene, variables: TreeVariables) -> TreeVariables:
        """Return the variables of each body, normalised."""
        return {
            branch.body: branch.without_drift(variables[branch.body]) for branch in _branches(scene)
        }

    def with_speeds(
        self, scene: Scene, variables: TreeVariables, others: TreeVariables
    ) -> TreeVariables:
        """Return the variables of each body with the speeds of `others`."""
        return {
            branch.body: branch.with_speeds(variables[branch.body], others[branch.body])
            for branch in _branches(scene)
        }


def _branches(scene: Scene) -> list[AbstractBranch]:
    return [branch for tree in forest(scene) for branch in tree]


class JointMechanics(AbstractMechanics):
    """Mechanics of several trees; the speeds of one tree follow those of the other."""

    def __init__(self, scene: Scene, variables: TreeVariables, motions: Motions):
        self.motions = motions
        self._trees = [TreeMechanics(scene, tree, variables, motions) for tree in forest(scene)]

    def _per_tree(self, numbers: Speeds) -> Iterator[tuple[TreeMechanics, Speeds]]:
        first = 0
        for tree in self._trees:
            yield tree, numbers[first : first + tree.size]
            first += tree.size

    def free_rates(self, wrenches: Wrenches) -> Speeds:
        """Return the rates of the speeds of all trees."""
        return [rate for tree in self._trees for rate in tree.free_rates(wrenches)]

    def projected(self, wrenches: Wrenches) -> Speeds:
        """Return the generalised forces on the speeds of all trees."""
        return [force for tree in self._trees for force in tree.projected(wrenches)]

    def solved(self, forces: Speeds) -> Speeds:
        """Solve with the factorised mass matrix of each tree."""
        return [rate for tree, part in self._per_tree(forces) for rate in tree.solved(part)]

    def bias(self, row: Row) -> Scalar:
        """Return the sum over all trees."""
        total: Scalar = 0.0
        for tree in self._trees:
            total = add(total, tree.bias(row))
        return total

    def accelerations(self, rates: Speeds) -> dict[str, BodyAcceleration]:
        """Return the accelerations of the bodies of all trees."""
        parts = [tree.accelerations(part) for tree, part in self._per_tree(rates)]
        return {name: body for part in parts for name, body in part.items()}

    def variable_rates(self, rates: Speeds) -> TreeVariables:
        """Return the rates of the variables of all trees."""
        parts = [tree.variable_rates(part) for tree, part in self._per_tree(rates)]
        return {name: body for part in parts for name, body in part.items()}

    def after_displacement(self, changes: Speeds) -> TreeVariables:
        """Return the variables of all trees after a small displacement along their speeds."""
        parts = [tree.after_displacement(part) for tree, part in self._per_tree(changes)]
        return {name: body for part in parts for name, body in part.items()}

    def after_speed_change(self, changes: Speeds) -> TreeVariables:
        """Return the variables of all trees after changes of their speeds."""
        parts = [tree.after_speed_change(part) for tree, part in self._per_tree(changes)]
        return {name: body for part in parts for name, body in part.items()}
