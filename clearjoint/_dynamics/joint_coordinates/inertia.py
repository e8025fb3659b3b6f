"""Solutions of the equations of motion of a tree of bodies for its rates r (see `.coordinates`).

The composite rigid body algorithm (R. Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 6)
fills the mass matrix, whose factorisation takes fewer operations in a small tree. The articulated
body algorithm (ch. 7) eliminates the rates of each joint before it goes on to the carrier, so that
the number of operations is proportional to the number of bodies. All twists, loads and inertias are
in the axes of the tree, and refer to the reference point of their link unless another is named.
"""

import abc
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from heapq import heapify, heappop, heappush
from itertools import accumulate, chain, pairwise
from typing import TypeAlias, TypeVar

import jax
from jaxtyping import PyTree
from typing_extensions import override

from ..._compilation.xla import NotSharedError, traced_for_a_kind
from ..._math.linear_solvers import Factorisation
from ..._math.vectors import IDENTITY, ZERO, Matrix, Scalar, Vector, add, multiply, subtract
from ..._model.bodies import Body
from ..._model.joints.motion_subspaces import REST, Twist
from ..._model.tree_dataclass import tree_dataclass
from ..coordinates import Speeds
from .trees import Link

Result = TypeVar("Result")
LinkLoads: TypeAlias = Mapping[int, Twist]
"""Loads on links by their index: moment about the reference point, N m, and force, N."""
Parents: TypeAlias = Sequence[int | None]
"""Index of the parent of each link in its tree, ``None`` for the root."""


@tree_dataclass
class Inertia:
    """Inertia of a body and of the bodies it carries, as far as their joints transmit it, about the
    body's reference point and in the tree's axes.

    The inertia maps a twist of angular velocity w and velocity v to the angular momentum I w + C v
    and the momentum C^T w + M v, with I = `angular` (kg m^2), C = `coupling` (kg m) and M = `mass`
    (kg). M is a multiple of the identity only for a single body.
    """

    mass: Matrix
    coupling: Matrix
    angular: Matrix

    def __add__(self, other: "Inertia") -> "Inertia":
        mass, coupling = self.mass + other.mass, self.coupling + other.coupling
        return Inertia(mass, coupling, self.angular + other.angular)

    def momentum(self, twist: Twist) -> Twist:
        """Return angular momentum (kg m^2/s) and momentum (kg m/s) for a twist."""
        return Twist(
            self.angular @ twist.angular + self.coupling @ twist.linear,
            self.coupling.transposed_times(twist.angular) + self.mass @ twist.linear,
        )

    def without(
        self, columns: Sequence[Twist], wholes: Sequence[Twist], rests: Sequence[Twist]
    ) -> "Inertia":
        """Return the part of this inertia that acts on a joint's carrier while all rates r of the
        joint are zero. This inertia is that of all bodies which the joint carries.

        With r = 0, the carried bodies do not follow the carrier's angular acceleration about the
        joint's axis (see `.coordinates`), so that their inertia about this axis does not act on the
        carrier. Let M be the 6x6 matrix of this inertia, column the twist for a unit of the joint's
        speed, axis this twist with a linear part of zero, and whole = M column. The matrix P = 1 -
        column axis^T removes the rotation about the axis from a twist. The result is P^T M P = M -
        axis whole^T - rest axis^T with rest = P^T whole. `momenta` returns `wholes` and `rests`,
        one for each column: all their terms are subtracted.
        """
        angular, coupling = self.angular, self.coupling
        for column, whole, rest in zip(columns, wholes, rests, strict=True):
            axis = column.angular
            coupling = coupling.minus_outer(axis, whole.linear)
            angular = _minus_symmetric(angular, axis, whole.angular)
            angular = _minus_symmetric(angular, rest.angular, axis)
        return Inertia(self.mass, coupling, angular)

    def minus_outer(self, first: Twist, second: Twist) -> "Inertia":
        """Return this inertia minus the outer product of two twists. The caller subtracts
        products whose sum is symmetric. So only the lower triangles of the mass and the angular
        part are computed; their entries are copied to the upper triangles."""
        return Inertia(
            _minus_symmetric(self.mass, first.linear, second.linear),
            self.coupling.minus_outer(first.angular, second.linear),
            _minus_symmetric(self.angular, first.angular, second.angular),
        )

    def shifted(self, offset: Vector) -> "Inertia":
        """Return this inertia about another point, from which `offset` leads to the present one."""
        # The columns of the coupling change by the cross products of `offset` with the columns,
        # which are also the rows, of the mass.
        columns = zip(self.coupling.T.rows, self.mass.rows, strict=True)
        coupling = Matrix(*(column + offset.cross(row) for column, row in columns)).T
        # The angular part changes by the cross products with the rows of the coupling about the
        # present point (in columns) and about the new one (in rows).
        before = [tuple(offset.cross(row)) for row in self.coupling.rows]
        after = [tuple(offset.cross(row)) for row in coupling.rows]
        present = [tuple(row) for row in self.angular.rows]
        angular = _symmetric(lambda i, j: add(add(present[i][j], before[j][i]), after[i][j]))
        return Inertia(self.mass, coupling, angular)


def _minus_symmetric(matrix: Matrix, first: Vector, second: Vector) -> Matrix:
    """Return the symmetric matrix whose lower triangle is that of `matrix` - `first` `second`^T."""
    rows, a, b = [tuple(row) for row in matrix.rows], tuple(first), tuple(second)
    return _symmetric(lambda i, j: subtract(rows[i][j], multiply(a[i], b[j])))


def central_inertia(body: Body, rotation: Matrix) -> Matrix:
    """Return a body's inertia about its centre of mass, kg m^2, in the axes to which `rotation`
    transforms components in body axes."""
    # Entry i, j is (row i of the rotation) . (inertia times row j of the rotation).
    images = [body.angular_momentum(row) for row in rotation.rows]
    return _symmetric(lambda i, j: rotation.rows[i].dot(images[j]))


def inertia(mass: Scalar, arm: Vector, central: Matrix) -> Inertia:
    """Return the spatial inertia of a body about its reference point. The `arm`, m, leads from this
    point to the centre of mass, about which `central` is the inertia, kg m^2."""
    # The first moment of mass h, kg m, determines the coupling, which is its cross-product matrix.
    h, r = arm * mass, tuple(arm)
    moments = tuple(h)

    def shift(i: int, j: int) -> Scalar:  # parallel axes: m (r.r identity - r r^T)
        if i != j:
            return subtract(0.0, multiply(moments[i], r[j]))
        # On the diagonal, r_i^2 cancels, so that only the other two components count.
        p, q = (i + 1) % 3, (i + 2) % 3
        return add(multiply(moments[p], r[p]), multiply(moments[q], r[q]))

    coupling = Matrix(
        Vector(0.0, subtract(0.0, h.z), h.y),
        Vector(h.z, 0.0, subtract(0.0, h.x)),
        Vector(subtract(0.0, h.y), h.x, 0.0),
    )
    masses = Matrix(*(row * mass for row in IDENTITY.rows))
    return Inertia(masses, coupling, central + _symmetric(shift))


def _symmetric(entry: Callable[[int, int], Scalar]) -> Matrix:
    lower = {(i, j): entry(i, j) for i in range(3) for j in range(i + 1)}
    return Matrix(*(Vector(*(lower[max(i, j), min(i, j)] for j in range(3))) for i in range(3)))


def product(first: Twist, second: Twist) -> Scalar:
    """Return the sum of products of components, angular with angular and linear with linear: of a
    load and a twist, the power, W; of a load and a column (the twist for a unit of a joint's
    speed), the generalised force."""
    return add(first.angular.dot(second.angular), first.linear.dot(second.linear))


def load_about(load: Twist, offset: Vector) -> Twist:
    """Return a load about another point. `offset`, m, leads from there to the present point."""
    return Twist(load.angular + offset.cross(load.linear), load.linear)


def at_offset(twist: Twist, offset: Vector) -> Twist:
    """Return a twist at another point, to which `offset`, m, leads from the present point."""
    return Twist(twist.angular, twist.linear + twist.angular.cross(offset))


def constrained(columns: Sequence[Twist], load: Twist, along: Speeds) -> Twist:
    """Return the part of a load or momentum of carried bodies that acts on their carrier if the
    joint's rates r are given. `columns`: the joint's twists, one for a unit of each speed; `along`:
    the `product` of the load with each column.

    With given r, the carrier's angular acceleration about the joint's free axes does not turn the
    carried bodies (see `.coordinates`): moments about these axes do not act on the carrier. The
    result has all forces, but no moments about the free axes; about a screw's axis it has the
    moment -pitch (m/rad) times the force along the axis.
    """
    moment = load.angular
    for column, part in zip(columns, along, strict=True):
        moment = moment - column.angular * part
    return Twist(moment, load.linear)


def projected(columns: Sequence[Twist], offset: Vector, load: Twist) -> tuple[Speeds, Twist]:
    """Return two effects of a `load` on a carried body: the generalised force for each of the
    joint's `columns`; and the part of the load that acts on the carrier (see `constrained`), about
    a point from which `offset` leads to the point of `load`."""
    along = [product(column, load) for column in columns]
    return along, load_about(constrained(columns, load, along), offset)


def momenta(
    columns: Sequence[Twist], carried: Inertia, armature: Scalar | None
) -> tuple[list[Twist], list[Speeds], list[Twist]]:
    """Return three lists, each with one entry for each of the `columns`, which are the twists for a
    unit of each joint speed: the momentum of the carried bodies with this twist; the products of
    this momentum with all `columns`; its part that acts on the carrier (see `constrained`).

    The last two include a rotor of inertia J, the `armature`. It resists u' = r - axis . (angular
    acceleration of the carrier), where axis is the angular part of the column: J is added to the
    product of a column with itself, and -J axis to the part that acts on the carrier.
    `Inertia.without`, which subtracts this part times axis^T, thus adds J axis axis^T.
    """
    wholes = [carried.momentum(column) for column in columns]
    # Row k of the block has the products of the momentum for a unit of speed k.
    block = [[product(column, whole) for column in columns] for whole in wholes]
    rests = [constrained(columns, *pair) for pair in zip(wholes, block, strict=True)]
    if armature is not None:
        for k, column in enumerate(columns):
            block[k][k] = add(block[k][k], armature)
            rests[k] = rests[k] - Twist(column.angular * armature, ZERO)
    return wholes, block, rests


def _unflatten(names: tuple[str, ...], values: Iterable[object]) -> Factorisation:
    # Without the constructor, which would factorise a matrix.
    factors = object.__new__(Factorisation)
    vars(factors).update(zip(names, values, strict=True))
    return factors


# Traced functions, such as `LoadedJoint.under`, return factors, which must be a PyTree for this.
jax.tree_util.register_pytree_node(
    Factorisation, lambda factors: (list(vars(factors).values()), tuple(vars(factors))), _unflatten
)


@tree_dataclass
class LoadedJoint:
    """A joint with the inertia of all bodies that it carries.

    - `columns`, `offset`: as in the `Link` of the carried body.
    - `factors`: of D = columns^T M columns plus armature, with the inertia M of the carried bodies.
    - `rests`: for each column, the part of the carried bodies' momentum with this twist that acts
      on the carrier, with the rotor's part (last result of `momenta`); empty for a root.
    - `gains`: D^-1 `rests`. The joint's rates r are those for a carrier that does not accelerate,
      less the products of the gains with the carrier's acceleration.
    """

    columns: tuple[Twist, ...]
    offset: Vector
    factors: Factorisation
    rests: tuple[Twist, ...]
    gains: tuple[Twist, ...]

    @staticmethod
    def under(
        columns: tuple[Twist, ...],
        offset: Vector,
        carried: Inertia,
        carrier: Inertia,
        armature: Scalar | None,
    ) -> "tuple[LoadedJoint, Inertia]":
        """Return a joint, and the inertia `carrier` plus what the joint transmits of `carried`."""
        wholes, block, rests = momenta(columns, carried, armature)
        factors = Factorisation(block)
        transmitted = carried.without(columns, wholes, rests)
        # `rests` has a twist for each speed of the joint. Their transpose has a row for each of the
        # six components of a twist, for which the factors solve.
        components = [(*rest.angular, *rest.linear) for rest in rests]
        solved = [factors.solve(row) for row in zip(*components, strict=True)]
        gains = tuple(Twist(Vector(*g[:3]), Vector(*g[3:])) for g in zip(*solved, strict=True))
        for rest, gain in zip(rests, gains, strict=True):
            transmitted = transmitted.minus_outer(rest, gain)
        joint = LoadedJoint(columns, offset, factors, tuple(rests), gains)
        return joint, carrier + transmitted.shifted(offset)


def absorbed(
    joint: LoadedJoint, load: Twist, carrier: Twist, forces: Speeds
) -> tuple[Speeds, Twist]:
    """Return the rates r of a joint whose carrier does not accelerate, under the total `load` on
    the carried body and the generalised `forces` in the joint; and the total load on the carrier,
    which is the load `carrier` plus the part of `load` that the joint transmits."""
    along = [product(column, load) for column in joint.columns]
    alone = joint.factors.solve([add(f, a) for f, a in zip(forces, along, strict=True)])
    transmitted = constrained(joint.columns, load, along)
    # The carried bodies' momentum changes by the rates. A root has no `rests`: the load on the
    # ground is not needed.
    for rest, rate in zip(joint.rests, alone, strict=False):
        transmitted = transmitted - rest * rate
    return alone, carrier + load_about(transmitted, joint.offset)


def followed(joint: LoadedJoint, alone: Speeds, carrier: Twist) -> tuple[Speeds, Twist]:
    """Return the rates r of a joint, which are accelerations, and the acceleration of its body, for
    the acceleration `carrier` of its carrier. `alone`: the rates r if the latter is zero."""
    twist, rates = at_offset(carrier, joint.offset), alone
    if joint.gains:
        pairs = zip(alone, joint.gains, strict=True)
        rates = [subtract(rate, product(gain, twist)) for rate, gain in pairs]
    return rates, accelerated(joint.columns, rates, joint.offset, carrier)[0]


def accelerated(
    columns: Sequence[Twist], rates: Speeds, offset: Vector, carrier: Twist
) -> tuple[Twist, Speeds]:
    """Return the acceleration of a body and the rates u' of its joint, both without the parts at
    constant speeds. `columns`: twist for a unit of each joint speed. `rates`: the joint's r.
    `carrier`: the carrier's acceleration. `offset`: from its reference point to the body's, m."""
    # u' = r - axis . (angular acceleration of the carrier)
    pairs = zip(columns, rates, strict=True)
    relative = [subtract(rate, column.angular.dot(carrier.angular)) for column, rate in pairs]
    twist = at_offset(carrier, offset)
    for column, rate in zip(columns, relative, strict=True):
        twist = twist + column * rate
    return twist, relative


LARGEST_DENSE = 4
"""Number of bodies up to which a tree gets a mass matrix, instead of the recursion over its bodies.

For four bodies, the matrix takes 0.8 (Bricard's linkage) to 1.14 times (planar chain of hinges) as
many operations as the recursion; for eight, 0.95 to 1.8 times. With a matrix, all inertias of a
tree refer to one point, so that terms of distant bodies cancel in the factorisation: in random
chains, its rounding errors equal the recursion's for two bodies, and are two, six and twenty times
as large for four, ten and thirty.
"""


def is_small(bodies: int) -> bool:
    """Return whether a tree of this number of bodies gets a mass matrix."""
    return bodies <= LARGEST_DENSE


Evaluate: TypeAlias = Callable[..., PyTree]
"""Function that calls its first argument, a function, with the other arguments."""


def evaluation(bodies: int) -> Evaluate:
    """Return the `Evaluate` with which functions are called for a tree of this number of bodies. In
    a large tree, it traces a function only once for all arguments that differ only in the numbers
    of arrays (see `traced_for_a_kind`)."""
    return operator.call if is_small(bodies) else _traced_once


def _traced_once(function: Callable[..., Result], *arguments: PyTree) -> Result:
    # With `is_called=False`, native code repeats the equations for each branch. If it called one
    # function, a program that needs fewer of the function's results would fuse products with sums
    # otherwise, and lanes of sweeps, which another program computes, would differ in the last bit.
    with suppress(NotSharedError):
        return traced_for_a_kind(function, *arguments, is_called=False)
    return function(*arguments)


class AbstractTreeSolver(abc.ABC):
    """Base class of solvers of the equations of motion of one tree, from each body's inertia."""

    def __init__(self, links: Sequence[Link], parents: Parents, inertias: Sequence[Inertia]):
        self._links, self._parents = links, parents
        self._evaluate = evaluation(len(links))
        self._prepare(list(inertias))

    @abc.abstractmethod
    def _prepare(self, carried: list[Inertia]) -> None:
        """Factorise the equations. `carried` has the inertia of each link, and may be changed."""

    @abc.abstractmethod
    def rates(self, loads: LinkLoads, forces: Sequence[Speeds]) -> list[Speeds]:
        """Return the rates r that loads on links, and generalised forces in all joints, cause."""


class MassMatrix(AbstractTreeSolver):
    """Composite rigid body algorithm. The links must have one reference point in common."""

    @override
    def _prepare(self, carried: list[Inertia]) -> None:
        links = self._links
        # Index of the first speed of each link, and the number of all speeds at the end.
        self._firsts = list(accumulate((len(link.columns) for link in links), initial=0))
        matrix: list[list[Scalar]] = [[0.0] * (i + 1) for i in range(self._firsts[-1])]
        # The loop goes from the leaves to the root. When it reaches a link, `carried` has the
        # inertia of the link and of all bodies that it carries, as far as their joints transmit it.
        for k in reversed(range(len(links))):
            columns, first_row, parent = links[k].columns, self._firsts[k], self._parents[k]
            # For a unit of each speed of link k: the momentum of all that the joint carries, its
            # products with `columns`, and its part that acts on the carrier.
            wholes, block, rests = momenta(columns, carried[k], links[k].armature)
            for j, rest in enumerate(rests):
                # A row ends at the diagonal: its last j + 1 entries are products with columns of
                # link k itself. The entries before them are products with columns of its carriers.
                matrix[first_row + j][first_row:] = block[j][: j + 1]
                self._fill_row(matrix[first_row + j], parent, rest)
            # Unknowns r are relative to a carrier that is not accelerated about the joint's axes
            # (see `.coordinates`), so that inertia about these axes does not act on the carrier.
            if parent is not None:
                carried[parent] = carried[parent] + carried[k].without(columns, wholes, rests)
        self._factors = Factorisation(matrix)

    def _fill_row(self, row: list[Scalar], k: int | None, momentum: Twist) -> None:
        """Fill the entries of one speed's `row` for the speeds of link k (``None``: the ground)
        and its carriers. `momentum`: that which acts on link k, for a unit of the row's speed."""
        while k is not None:
            columns, first = self._links[k].columns, self._firsts[k]
            for j, column in enumerate(columns, first):
                row[j] = product(column, momentum)
            momentum = constrained(columns, momentum, row[first : first + len(columns)])
            k = self._parents[k]

    @override
    def rates(self, loads: LinkLoads, forces: Sequence[Speeds]) -> list[Speeds]:
        evaluate = [self._evaluate] * len(self._links)
        along = along_columns(self._links, self._parents, loads, evaluate)
        pairs = zip(chain(*forces), chain(*along), strict=True)
        rates = self._factors.solve([add(force, part) for force, part in pairs])
        return [rates[i:j] for i, j in pairwise(self._firsts)]


class ArticulatedBodies(AbstractTreeSolver):
    """Articulated body algorithm, which eliminates joint after joint."""

    @override
    def _prepare(self, carried: list[Inertia]) -> None:
        self._joints: list[LoadedJoint] = []
        for k in reversed(range(len(self._links))):
            link, parent = self._links[k], self._parents[k]
            if parent is None:
                # The ground does not accelerate: the joint needs no `rests` and `gains`.
                _, block, _ = momenta(link.columns, carried[k], link.armature)
                joint = LoadedJoint(link.columns, ZERO, Factorisation(block), rests=(), gains=())
            else:
                inertias = carried[k], carried[parent]
                joint, carried[parent] = self._evaluate(
                    LoadedJoint.under, link.columns, link.offset, *inertias, link.armature
                )
            self._joints.append(joint)
        self._joints.reverse()

    @override
    def rates(self, loads: LinkLoads, forces: Sequence[Speeds]) -> list[Speeds]:
        # From the leaves to the root, rates as if no carrier accelerated; then from the root to the
        # leaves, the accelerations of the bodies and the rates with them.
        totals = [loads.get(k, REST) for k in range(len(self._links))]
        # The list `alone` is filled from the leaves to the root, and so is read in reverse below.
        alone: list[Speeds] = []
        for k in reversed(range(len(self._links))):
            parent = self._parents[k]
            on_carrier = REST if parent is None else totals[parent]
            rates_alone, total = self._evaluate(
                absorbed, self._joints[k], totals[k], on_carrier, forces[k]
            )
            alone.append(rates_alone)
            if parent is not None:
                totals[parent] = total
        rates: list[Speeds] = []
        twists: list[Twist] = []
        joints = zip(self._parents, self._joints, reversed(alone), strict=True)
        for parent, joint, rates_alone in joints:
            carrier = REST if parent is None else twists[parent]
            joint_rates, twist = self._evaluate(followed, joint, rates_alone, carrier)
            rates.append(joint_rates)
            twists.append(twist)
        return rates


def tree_solver(
    links: Sequence[Link], parents: Parents, bodies: Sequence[Body], central: Sequence[Matrix]
) -> AbstractTreeSolver:
    """Return the solver for a tree. `central`: inertias about the centres of mass, kg m^2, in the
    axes of the tree."""
    evaluate = evaluation(len(links))
    inertias = [
        evaluate(inertia, body.mass, link.arm, about_centre)
        for body, link, about_centre in zip(bodies, links, central, strict=True)
    ]
    kind = MassMatrix if is_small(len(links)) else ArticulatedBodies
    return kind(links, parents, inertias)


def along_columns(
    links: Sequence[Link], parents: Parents, loads: LinkLoads, evaluate: Sequence[Evaluate]
) -> list[Speeds]:
    """Return, for each link, the generalised forces in its joint, one for each of the joint's
    speeds, due to `loads` on the link and on all that it carries. `evaluate`: for each link, the
    `evaluation` of its tree, which calls a function and, in a large tree, traces it only once."""
    totals = dict(loads)
    forces: list[Speeds] = [[0.0] * len(link.columns) for link in links]
    # Each link comes after its parent. Links are visited by falling index, so that all loads on a
    # link are known when they are passed on; the heap returns the smallest, so indices are negated.
    waiting = [-k for k in totals]
    heapify(waiting)
    while waiting:
        k = -heappop(waiting)
        link, parent = links[k], parents[k]
        forces[k], transmitted = evaluate[k](projected, link.columns, link.offset, totals[k])
        if parent is None:  # The load on the ground is not needed.
            continue
        if parent in totals:
            totals[parent] = totals[parent] + transmitted
        else:
            heappush(waiting, -parent)
            totals[parent] = transmitted
    return forces
