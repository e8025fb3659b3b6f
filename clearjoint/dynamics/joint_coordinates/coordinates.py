"""Joint coordinates: angles and distances in ideal joints, which then need no constraints.

A clearance joint is a force element, so it does not close a loop, and in most mechanisms with
clearances the bodies and ideal joints form trees. In joint coordinates, a tree has no multipliers,
no drift and no redundant constraints, and few variables. Ideal joints that close a loop remain
constraints.
"""

from ...model.bodies import GROUND, GROUND_MOTION, BodyState, Motion
from ...model.joints.base import Motions
from ...model.scene import Scene
from ..coordinates import AbstractCoordinates, free_motion
from .branches import UPRIGHT, AbstractBranch, JointedBranch, forest
from .composite_rigid_body import JointMechanics, TreeVariables


class JointCoordinates(AbstractCoordinates):
    """Relative positions and speeds in the ideal joints that carry the bodies.

    A free body has the same variables as in absolute coordinates: a `BodyState`, whose position is
    relative to the body's `Anchor`, a fixed point near it, if it has one.

    These coordinates are the default, because they are faster on every mechanism measured. The
    table shows the time in µs of one evaluation of the equations of motion, in a native loop of one
    lane:

    | mechanism | joint coordinates | absolute coordinates |
    |---|---|---|
    | double pendulum with clearance | 0.14 | 0.24 |
    | the same, a lane in a batch of 64 | 0.04 | 0.07 |
    | ideal double pendulum | 0.03 | 0.38 |
    | double four-bar | 0.25 | 50 |
    | Bricard | 0.5 | 45 |
    | chain of 4 bodies, changing axes | 0.2 | 34 |
    | chain of 12 bodies, changing axes | 2.3 | 150 |

    The large ratios arise because fewer constraints are left, and their equations need no LAPACK.

    >>> cj.Settings(coordinates=cj.JointCoordinates()).coordinates
    JointCoordinates()
    """

    def eliminated(self, scene: Scene) -> frozenset[str]:
        """Return the names of the ideal joints that carry a body of a tree. Their coordinates are
        the variables, so that they need no constraints."""
        return frozenset(
            branch.joint for branch in _branches(scene) if isinstance(branch, JointedBranch)
        )

    def encode(self, scene: Scene, bodies: dict[str, BodyState]) -> TreeVariables:
        """Return the variables for given states of the bodies, by name.

        If a state violates an ideal joint that carries a body, the violation is dropped: the
        variables describe a motion that satisfies the joint.
        """
        poses = {GROUND: (UPRIGHT, GROUND_MOTION)}
        poses |= {n: (body.orientation, free_motion(body, None)) for n, body in bodies.items()}
        return {
            branch.body: branch.encode(poses[branch.parent], poses[branch.body])
            for branch in _branches(scene)
        }

    def decode(self, scene: Scene, variables: TreeVariables) -> dict[str, BodyState]:
        """Return the states of the bodies, by name."""
        motions, orientations = self.motions(scene, variables), {GROUND: UPRIGHT}
        for branch in _branches(scene):
            state = variables[branch.body]
            orientations[branch.body] = branch.orientation(orientations[branch.parent], state)
        bodies = {}
        for name in scene.bodies:
            at, orientation = motions[name], orientations[name]
            bodies[name] = BodyState(at.position, orientation, at.velocity, at.spin)
        return bodies

    def motions(self, scene: Scene, variables: TreeVariables) -> Motions:
        """Return pose and velocities of each body and of "ground", by name, computed from the roots
        to the leaves."""
        motions: dict[str, Motion] = {GROUND: GROUND_MOTION}
        for branch in _branches(scene):
            motions[branch.body] = branch.motion(motions[branch.parent], variables[branch.body])
        return motions

    def mechanics(self, scene: Scene, variables: TreeVariables) -> JointMechanics:
        """Return the equations of motion of all trees."""
        return JointMechanics(scene, variables, self.motions(scene, variables))

    def without_drift(self, scene: Scene, variables: TreeVariables) -> TreeVariables:
        """Return normalised variables of the same motion, by name of body: Euler parameters of unit
        norm, and angles between -2 pi and 2 pi."""
        return {
            branch.body: branch.without_drift(variables[branch.body]) for branch in _branches(scene)
        }

    def with_speeds(
        self, scene: Scene, variables: TreeVariables, others: TreeVariables
    ) -> TreeVariables:
        """Return variables with the positions of `variables` and the speeds of `others`, by name of
        body."""
        return {
            branch.body: branch.with_speeds(variables[branch.body], others[branch.body])
            for branch in _branches(scene)
        }


def _branches(scene: Scene) -> list[AbstractBranch]:
    """Return the branches of all trees of a scene; a parent comes before its children."""
    return [branch for tree in forest(scene) for branch in tree]
