"""The equations of motion of a tree in joint coordinates."""

from typing import Any

from .bodies import NO_WRENCH
from .coordinates import Acceleration, Motions, Speeds, Wrenches
from .joints.base import Row
from .joints.freedoms import REST, Twist
from .linear import OrderedFactorisation
from .links import Inertia, Link, central_inertia, inertia
from .scene import Scene
from .tree import Tree
from .vectors import ZERO, Scalar, Vector, add

Load = tuple[Vector, Vector]
"""Force, and moment about the centre of mass, in the tree's axes."""


class TreeMechanics:
    """One tree: its mass matrix by composite bodies (R. Featherstone, Rigid Body Dynamics
    Algorithms, 2008, ch. 6), factorised once for all forces and constraints."""

    def __init__(self, scene: Scene, tree: Tree, variables: dict[str, Any], motions: Motions):
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

    def _pairs(self) -> Any:
        return zip(self._tree, self._links, strict=True)

    def _own(self, k: int, numbers: Speeds) -> Speeds:
        """The part of the numbers that belongs to a link's own speeds."""
        return numbers[self._firsts[k] : self._firsts[k + 1]]

    def _mass_matrix(self) -> list[list[Scalar]]:
        """The lower triangle."""
        matrix: list[list[Scalar]] = [[0.0] * (i + 1) for i in range(self.size)]
        composites: list[Inertia] = [
            inertia(self._scene.bodies[branch.body], link.place, central)
            for (branch, link), central in zip(self._pairs(), self._central, strict=True)
        ]
        for k in reversed(range(len(self._links))):
            for i, column in enumerate(self._links[k].columns, self._firsts[k]):
                self._fill_row(matrix[i], i, k, composites[k].momentum(column))
            parent = self._parents[k]
            if parent is not None:
                composites[parent] = composites[parent] + composites[k]
        return matrix

    def _fill_row(self, row: list[Scalar], i: int, k: int, momentum: Twist) -> None:
        """Products with the link's own columns and those of the links that carry it."""
        ancestor: int | None = k
        while ancestor is not None:
            for j, column in enumerate(self._links[ancestor].columns, self._firsts[ancestor]):
                if j <= i:
                    along = column.slide.dot(momentum.slide)
                    row[j] = add(column.turn.dot(momentum.turn), along)
            ancestor = self._parents[ancestor]

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
        """H^T times wrenches."""
        return self._along_columns(
            [self._load(branch.body, link, wrenches) for branch, link in self._pairs()]
        )

    def _load(self, name: str, link: Link, wrenches: Wrenches) -> Load:
        wrench = wrenches.get(name, NO_WRENCH)
        force = self._axes.transposed_times(wrench.force)
        return force, link.rotation @ wrench.moment

    def _along_columns(self, loads: list[Load]) -> Speeds:
        """Forces on the speeds, from the leaves to the root."""
        totals = [
            (force, moment + link.place.cross(force))
            for (force, moment), link in zip(loads, self._links, strict=True)
        ]
        forces: Speeds = [0.0] * self.size
        for k in reversed(range(len(totals))):
            force, moment = totals[k]
            for i, column in enumerate(self._links[k].columns, self._firsts[k]):
                forces[i] = add(column.turn.dot(moment), column.slide.dot(force))
            parent = self._parents[k]
            if parent is not None:
                totals[parent] = (totals[parent][0] + force, totals[parent][1] + moment)
        return forces

    def bias(self, row: Row) -> Scalar:
        """The row's Jacobian times the accelerations at constant speeds."""
        total: Scalar = 0.0
        for branch, link in self._pairs():
            force, moment = self._load(branch.body, link, row.jacobian)
            bias = link.bias + self._fall
            total = add(total, add(force.dot(bias), moment.dot(link.turn_bias)))
        return total

    def accelerations(self, rates: Speeds) -> dict[str, Acceleration]:
        """Accelerations of the bodies, from the root to the leaves."""
        found, twists = {}, []
        for k, (branch, link) in enumerate(self._pairs()):
            parent = self._parents[k]
            twist = REST if parent is None else twists[parent]
            for column, rate in zip(link.columns, self._own(k, rates), strict=True):
                twist = twist + column * rate
            twists.append(twist)
            linear = twist.slide + twist.turn.cross(link.place) + link.bias + self._fall
            angular = link.rotation.transposed_times(twist.turn + link.turn_bias)
            found[branch.body] = Acceleration(self._axes @ linear, angular)
        return found

    def variable_rates(self, rates: Speeds) -> dict[str, Any]:
        """Time derivatives of the variables."""
        return {
            branch.body: branch.rates(
                self._variables[branch.body], self._own(k, rates), self._axes, self._gravity
            )
            for k, branch in enumerate(self._tree)
        }
