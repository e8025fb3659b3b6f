"""The equations of motion of a tree in joint coordinates.

By composite bodies (R. Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 6), with one change
of unknowns. The rate of a joint's angle is counted against a carrier that does not turn about its
axis: u' = u + axis . (angular acceleration of the carrier). What the carried bodies do along the
axis then never enters the carrier's equations. Otherwise it enters twice, with opposite signs: the
double pendulum's arm 2 with its 0.001 kg m^2 about the hinge then carries the rounding errors of
arm 3's 2.3 kg m^2, which cost two digits of the last impacts. Where axes are coordinate axes, the
terms are structural zeros besides.
"""

from collections.abc import Iterator
from typing import TypeAlias

from ...math.linear_solvers import OrderedFactorisation
from ...math.vectors import ZERO, Scalar, Vector, add, subtract
from ...model.bodies import NO_WRENCH
from ...model.joints.base import Motions, Row
from ...model.joints.motion_subspaces import REST, Twist
from ...model.scene import Scene
from ..coordinates import BodyAcceleration, MotionVariables, Speeds, Wrenches
from .branches import AbstractBranch
from .links import Link
from .spatial_inertia import Inertia, central_inertia, inertia
from .tree import Tree

ForceAndMoment: TypeAlias = tuple[Vector, Vector]
"""Force, and moment about the centre of mass, in the tree's axes."""


class TreeMechanics:
    """One tree: its mass matrix, factorised once for all forces and constraints."""

    def __init__(
        self, scene: Scene, tree: Tree, variables: dict[str, MotionVariables], motions: Motions
    ):
        self._scene, self._tree, self._variables = scene, tree, variables
        self._axes = motions[tree[0].body].rotation
        self._gravity = ZERO if scene.gravity is None else scene.gravity
        gravity = self._axes.transposed_times(self._gravity)
        self._fall, self._weight = (gravity, ZERO) if tree[0].falls() else (ZERO, gravity)
        index = {branch.body: k for k, branch in enumerate(tree)}
        self._parents = [index.get(branch.parent) for branch in tree]
        self._links: list[Link] = []
        for branch, parent in zip(tree, self._parents, strict=True):
            carrier = None if parent is None else self._links[parent]
            self._links.append(branch.link(carrier, variables[branch.body]))
        self._central = [
            central_inertia(scene.bodies[branch.body], link.rotation)
            for branch, link in self._pairs()
        ]
        self._firsts = [0]
        for link in self._links:
            self._firsts.append(self._firsts[-1] + len(link.columns))
        self.size = self._firsts[-1]
        self._factorisation = OrderedFactorisation(self._mass_matrix())

    def _pairs(self) -> Iterator[tuple[AbstractBranch, Link]]:
        return zip(self._tree, self._links, strict=True)

    def _mass_matrix(self) -> list[list[Scalar]]:
        """The lower triangle, from the leaves to the root."""
        matrix: list[list[Scalar]] = [[0.0] * (i + 1) for i in range(self.size)]
        composites: list[Inertia] = [
            inertia(self._scene.bodies[branch.body], link.place, central)
            for (branch, link), central in zip(self._pairs(), self._central, strict=True)
        ]
        for k in reversed(range(len(self._links))):
            columns, first = self._links[k].columns, self._firsts[k]
            wholes = [composites[k].momentum(column) for column in columns]
            own = [[_product(column, whole) for column in columns] for whole in wholes]
            rests = [_rest(columns, *pair) for pair in zip(wholes, own, strict=True)]
            for j, rest in enumerate(rests):
                matrix[first + j][first:] = own[j][: j + 1]
                self._fill_row(matrix[first + j], self._parents[k], rest)
            parent = self._parents[k]
            if parent is not None:
                seen = composites[k]
                for column, whole, rest in zip(columns, wholes, rests, strict=True):
                    seen = seen.without(column.angular, whole, rest)
                composites[parent] = composites[parent] + seen
        return matrix

    def _fill_row(self, row: list[Scalar], k: int | None, momentum: Twist) -> None:
        """Products with the columns of a link and those of the links that carry it."""
        while k is not None:
            columns, first = self._links[k].columns, self._firsts[k]
            for j, column in enumerate(columns, first):
                row[j] = _product(column, momentum)
            momentum = _rest(columns, momentum, row[first : first + len(columns)])
            k = self._parents[k]

    def solved(self, forces: Speeds) -> Speeds:
        """The inverse of the mass matrix times forces."""
        return self._factorisation.solve(forces)

    def free_rates(self, wrenches: Wrenches) -> Speeds:
        """Rates of the speeds under wrenches, without constraints."""
        loads = []
        for k, (branch, link) in enumerate(self._pairs()):
            force, moment = self._load(branch.body, link, wrenches)
            central, mass = self._central[k], self._scene.bodies[branch.body].mass
            gyroscopic = link.spin.cross(central @ link.spin) + central @ link.turn_bias
            loads.append((force - (link.bias - self._weight) * mass, moment - gyroscopic))
        return self.solved(self._along_columns(loads))

    def projected(self, wrenches: Wrenches) -> Speeds:
        """Forces on the speeds: H^T times the wrenches, and zero where a body has none."""
        return self._along_columns(
            [self._load(branch.body, link, wrenches) for branch, link in self._pairs()]
        )

    def _load(self, name: str, link: Link, wrenches: Wrenches) -> ForceAndMoment:
        wrench = wrenches.get(name, NO_WRENCH)
        force = self._axes.transposed_times(wrench.force)
        return force, link.rotation @ wrench.moment

    def _along_columns(self, loads: list[ForceAndMoment]) -> Speeds:
        """Forces on the speeds, from the leaves to the root."""
        totals = [
            Twist(moment + link.place.cross(force), force)
            for (force, moment), link in zip(loads, self._links, strict=True)
        ]
        forces: Speeds = [0.0] * self.size
        for k in reversed(range(len(totals))):
            columns, first = self._links[k].columns, self._firsts[k]
            own = [_product(column, totals[k]) for column in columns]
            forces[first : first + len(own)] = own
            parent = self._parents[k]
            if parent is not None:
                totals[parent] = totals[parent] + _rest(columns, totals[k], own)
        return forces

    def bias(self, row: Row) -> Scalar:
        """The row's Jacobian times the accelerations at zero rates."""
        total: Scalar = 0.0
        for branch, link in self._pairs():
            force, moment = self._load(branch.body, link, row.jacobian)
            bias = link.bias + self._fall
            total = add(total, add(force.dot(bias), moment.dot(link.turn_bias)))
        return total

    def _spread_out(self, rates: Speeds) -> Iterator[tuple[Twist, Speeds]]:
        """From the root to the leaves: what a link's point at the origin does, and the part of the
        rates, counted against its carrier, that is its own."""
        twists: list[Twist] = []
        for k, link in enumerate(self._links):
            parent, own = self._parents[k], rates[self._firsts[k] : self._firsts[k + 1]]
            twist = REST if parent is None else twists[parent]
            own = [
                subtract(rate, column.angular.dot(twist.angular))
                for column, rate in zip(link.columns, own, strict=True)
            ]
            for column, rate in zip(link.columns, own, strict=True):
                twist = twist + column * rate
            twists.append(twist)
            yield twist, own

    def accelerations(self, rates: Speeds) -> dict[str, BodyAcceleration]:
        """Accelerations of the bodies."""
        accelerations = {}
        for (branch, link), (twist, _) in zip(self._pairs(), self._spread_out(rates), strict=True):
            linear = twist.linear + twist.angular.cross(link.place) + link.bias + self._fall
            angular = link.rotation.transposed_times(twist.angular + link.turn_bias)
            accelerations[branch.body] = BodyAcceleration(self._axes @ linear, angular)
        return accelerations

    def variable_rates(self, rates: Speeds) -> dict[str, MotionVariables]:
        """Time derivatives of the variables."""
        return {
            branch.body: branch.rates(state, own, self._axes, self._gravity)
            for branch, state, own in self._shared_out(rates)
        }

    def after_displacement(self, changes: Speeds) -> dict[str, MotionVariables]:
        """The variables after a small motion along the speeds."""
        return {
            branch.body: branch.after_displacement(state, own, self._axes)
            for branch, state, own in self._shared_out(changes)
        }

    def after_speed_change(self, changes: Speeds) -> dict[str, MotionVariables]:
        """The variables after changes of the speeds."""
        return {
            branch.body: branch.after_speed_change(state, own, self._axes)
            for branch, state, own in self._shared_out(changes)
        }

    def _shared_out(
        self, rates: Speeds
    ) -> Iterator[tuple[AbstractBranch, MotionVariables, Speeds]]:
        """Each branch with its variables and its own part of the rates."""
        for branch, (_, own) in zip(self._tree, self._spread_out(rates), strict=True):
            yield branch, self._variables[branch.body], own


def _product(first: Twist, second: Twist) -> Scalar:
    """Power of a load, or product of a momentum, with a twist."""
    return add(first.angular.dot(second.angular), first.linear.dot(second.linear))


def _rest(columns: tuple[Twist, ...], load: Twist, along: Speeds) -> Twist:
    """What a body passes on to the body that carries it: a load on it, or its momentum, without the
    moments `along` its own columns, which its joint leaves free."""
    moment = load.angular
    for column, part in zip(columns, along, strict=True):
        moment = moment - column.angular * part
    return Twist(moment, load.linear)
