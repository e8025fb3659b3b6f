"""Solvers and step-size controllers of diffrax, prepared for single steps.

diffrax loops over the stages of an explicit Runge-Kutta step, and decides inside the loop, for all
lanes together, whether the last stage of the previous step can be reused. `UnrolledExplicit` writes
the stages out instead. A step is then plain arithmetic: in a batch it takes a third of the time,
and each lane has the same digits as a single run. The rest is diffrax's.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial, reduce
from typing import TypeAlias, TypeVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, PyTree
from typing_extensions import override

from ..._compilation.xla import elementwise
from ..._fields.checks import require
from ..._fields.types import Single
from ..._math.stacked import Stacked, stacked, unstacked
from ..._math.vectors import Scalar, add, larger, multiply
from ..._native import evaluated
from .time_map import AbstractTimeMap

Weights = Float[np.ndarray, " n"]
Y = TypeVar("Y")
"""A PyTree with the variables of a run, or with their rates, per s."""
DenseInformation: TypeAlias = dict[str, PyTree[Scalar]]
"""Data from which a solver computes dense output. For `UnrolledExplicit`, "y0" are the variables at
the start of the step, and "stages" the rates in each stage, multiplied by the slope of the time map
if the step has one. Other solvers use other names."""


class UnrolledExplicit(diffrax.AbstractSolver):
    """An explicit Runge-Kutta solver whose stages are written out instead of computed in a loop.

    If the variables are many, a step computes them as one array (see `..._math.stacked`). The
    solver's state consists of the rates at the start of the next step.

    **Arguments:** `method`: diffrax's solver, which supplies the tableau.
    """

    method: diffrax.AbstractERK
    term_structure = diffrax.ODETerm

    @property
    @override
    def interpolation_cls(self) -> Callable[..., "DenseOutput"]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Function of `t0`, `t1` and the items of `DenseInformation` that returns dense output."""
        return partial(DenseOutput, self.method)

    @override
    def order(self, terms: diffrax.ODETerm) -> int | None:
        return self.method.order(terms)

    @override
    def error_order(self, terms: diffrax.ODETerm) -> Single | None:
        return self.method.error_order(terms)

    @override
    def func(self, terms: diffrax.ODETerm, t0: Scalar, y0: Y, args: PyTree) -> Y:
        return terms.vf(t0, y0, args)

    @override
    def init(self, terms: diffrax.ODETerm, t0: Scalar, t1: Scalar, y0: Y, args: PyTree) -> Y:
        del t1
        return terms.vf(t0, y0, args)

    def information_like(self, y: PyTree) -> "DenseInformation":
        """Return data with the structure and shapes of those for dense output of a step with the
        variables `y`. A loop needs such data as an initial value; the numbers have no meaning."""
        return {"y0": y, "stages": (stacked(y),) * self.method.tableau.num_stages}  # pyright: ignore[reportAttributeAccessIssue]

    @override
    def step(
        self,
        terms: diffrax.ODETerm,
        t0: Scalar,
        t1: Scalar,
        y0: Y,
        args: PyTree,
        solver_state: Y,
        made_jump: Scalar,
        time_map: AbstractTimeMap | None = None,
    ) -> tuple[Y, Y, DenseInformation, Y, diffrax.RESULTS]:
        """Compute one step from `t0` to `t1`, s, with arguments and results as in diffrax: the
        variables at `t1`, their error, the data for dense output, the new solver state, and a
        result code. Only if `made_jump` is the Python value ``False`` are the rates at `t0` those
        of `solver_state`; otherwise they are computed again. `time_map` maps the tableau's node of
        each stage to the elapsed part of the step's time; ``None`` if the two are equal. Error and
        data for dense output are `Stacked` if the variables are many."""
        tableau = _tableau(self.method)
        h = t1 - t0
        start = stacked(y0)
        # With a traced condition, every lane would compute both branches, so the rates are then
        # computed unconditionally.
        rates = stacked(solver_state) if made_jump is False else terms.vf(t0, start, args)
        # With a time map the independent variable is not the time t but a fraction x of the step,
        # 0 to 1. The tableau's nodes are values of x, and dy/dx = dy/dt dt/dx.
        stages, y = [_rates_by_fraction(rates, 0.0, time_map)], start
        # Each row has the weights with which one stage combines the stages before it.
        for row, fraction in zip(tableau.a_lower, tableau.c, strict=True):
            y = _advanced(start, h, row, stages)
            elapsed = fraction if time_map is None else time_map.elapsed(fraction)
            # The last stage is at exactly t1; t0 + h may differ from it by rounding.
            t = t1 if fraction == 1.0 else t0 + elapsed * h
            rates = terms.vf(t, y, args)
            stages.append(_rates_by_fraction(rates, fraction, time_map))
        # "Solution same as last" (`ssal`): the variables of the last stage are the result.
        # Otherwise the result has weights of its own.
        y1 = y if tableau.ssal else _advanced(start, h, tableau.b_sol, stages)
        # "First same as last" (`fsal`): the last stage was evaluated at the end of the step.
        if not tableau.fsal:
            rates = terms.vf(t1, y1, args)

        # The weights are the differences between those of the two embedded methods.
        def error_of(h: Scalar, *stage_rates: Scalar) -> Scalar:
            return multiply(h, _weighted(tableau.b_error, stage_rates))

        error = _by_leaf(error_of, h, *stages)
        information = {"y0": y0, "stages": tuple(stages)}
        return unstacked(y1), error, information, unstacked(rates), diffrax.RESULTS.successful


class DenseOutput(eqx.Module):
    """Dense output of a step: the variables between its start `t0` and its end `t1`, s.

    The polynomials are diffrax's. Sums over the stages are written out: a reduction of an array
    would be a loop between scalar operations, and XLA computes an expression that comes before a
    loop again at each of its uses after the loop. One derivative of one acceleration of the double
    pendulum had 59 MB of LLVM text and never compiled; without reductions it has 11 MB.

    **Arguments:** `stages`: the rates in each stage, times the slope of any `AbstractTimeMap`.
    """

    method: diffrax.AbstractERK
    t0: Scalar
    t1: Scalar
    y0: PyTree[Scalar]
    stages: tuple[PyTree[Scalar], ...]

    def evaluate(self, t: Scalar) -> PyTree[Scalar]:
        """Return the variables at the time t, s, if time is uniform in the step. With a time map,
        convert the time by `dense_time` in `.dense_output` first."""
        h = self.t1 - self.t0
        return self.at((t - self.t0) / jnp.where(h > 0.0, h, 1.0))

    def at(self, x: Scalar) -> PyTree[Scalar]:
        """Return the variables at a position x in the step, 0 to 1, on the same scale as the nodes
        c of the method's tableau. Without a time map, x is the elapsed part of the step's time;
        with a time map, that part is `time_map.elapsed(x)`."""
        h = self.t1 - self.t0
        # Of y0 + h sum b_i(x) f_i, the factors h b_i(x).
        weights = [h * _horner(row, x) for row in dense_weights(self.method)]

        # One variable at x, from its value at the start and its rate in each stage.
        def leaf(weights: list[Scalar], y0: Scalar, *stages: Scalar) -> Scalar:
            for weight, stage in zip(weights, stages, strict=True):
                y0 = add(y0, multiply(weight, stage))
            return y0

        start = stacked(self.y0) if isinstance(self.stages[0], Stacked) else self.y0
        return unstacked(_by_leaf(leaf, weights, start, *self.stages))


def _by_leaf(function: Callable[..., Scalar], numbers: PyTree[Scalar], *trees: Y) -> Y:
    # Apply `function` to `numbers` and corresponding leaves of `trees`. A leaf of a `Stacked` is an
    # array of many variables, for which `elementwise` makes one loop.
    if isinstance(trees[0], Stacked):
        function = partial(elementwise, function)
    return jax.tree.map(partial(function, numbers), *trees)


def _rates_by_fraction(rates: Y, x: float, time_map: AbstractTimeMap | None) -> Y:
    """Return `rates`, dy/dt, times the slope of the step's time map at the fraction x of the step,
    0 to 1; unchanged without a time map."""
    return rates if time_map is None else _by_leaf(multiply, time_map.slope(x), rates)


def _tableau(method: diffrax.AbstractERK) -> diffrax.ButcherTableau:
    assert isinstance(method.tableau, diffrax.ButcherTableau)
    return method.tableau


def _advanced(y0: Y, h: Scalar, weights: Weights, stages: Sequence[Y]) -> Y:
    def advanced(h: Scalar, y: Scalar, *rates: Scalar) -> Scalar:
        return add(y, multiply(h, _weighted(weights, rates)))

    return _by_leaf(advanced, h, y0, *stages)


def _weighted(weights: Weights, values: Sequence[Scalar]) -> Scalar:
    """Return the sum of `weights`, not all zero, times `values`, without operations for zeros."""
    pairs = zip(weights, values, strict=True)
    return reduce(add, [multiply(float(w), value) for w, value in pairs if w != 0.0])


def unrolled(solver: diffrax.AbstractSolver) -> diffrax.AbstractSolver:
    """Return an explicit Runge-Kutta method as an `UnrolledExplicit`, another solver unchanged."""
    single = diffrax.ButcherTableau
    if isinstance(solver, diffrax.AbstractERK) and isinstance(solver.tableau, single):
        return UnrolledExplicit(solver)
    return solver


def _horner(coefficients: Weights, x: Scalar) -> Scalar:
    """Return sum c_k x^k of `coefficients` c_k; c_0 is zero, as dense output is y0 at x = 0."""
    value: Scalar = float(coefficients[-1])
    for coefficient in coefficients[-2:0:-1]:
        value = value * x + float(coefficient)
    return value * x


@cache
def dense_weights(method: diffrax.AbstractERK) -> Float[np.ndarray, "stages powers"]:
    """Return the polynomials b_i of the dense output y0 + h sum b_i(x) f_i of a method, with the
    rates f_i in its stages and x from 0 to 1, as coefficients, (stages, degree + 1), lowest power
    first. diffrax has only an interpolant, linear in the f_i: the polynomials pass through its
    values at Chebyshev nodes x, with one f_i equal to 1 and the others 0."""
    tableau = _tableau(method)
    stages = tableau.num_stages
    # diffrax's interpolants have at most the order of the method as degree, but methods of low
    # order are interpolated by cubic Hermite polynomials.
    degree = max(method.order(None) or 1, 3)
    x = 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree)

    # Dense output at t of a step from y0 = 0 to y1; `k` are the rates in the stages.
    def value(t0: Scalar, t1: Scalar, y1: Scalar, k: jax.Array, t: Scalar) -> Scalar:
        return method.interpolation_cls(t0=t0, t1=t1, y0=0.0 * y1, y1=y1, k=k).evaluate(t)

    # A step of length 1 from y0 = 0 with the rates `unit[i]`, 1 in stage i and 0 in the others,
    # ends at y1 = b[i].
    b, unit = np.asarray(tableau.b_sol), np.eye(stages)
    rows = zip(b, unit, strict=True)
    calls = [(0.0, 1.0, *row, t) for row in rows for t in x]
    # The operations are executed one by one, in Python by `evaluated` or, if this function lacks a
    # rule for one of them, by JAX. A compiler would fuse them, and the digits would differ between
    # processors.
    numbers = evaluated(value, calls)
    if numbers is not None:
        values = np.reshape(numbers, (stages, len(x))).T
    else:
        with jax.ensure_compile_time_eval():
            y1, k = map(jax.device_put, (b, unit))
            values = np.array([value(0.0, 1.0, y1, k, t) for t in x])
    # Coefficients of the polynomials through these values.
    return np.linalg.solve(np.vander(x, increasing=True), values).T


def largest_component(tree: PyTree[Scalar]) -> jax.Array:
    """Return the largest magnitude in a PyTree, (), which step-size controllers use as error norm.
    A mean would hide the error of an impact behind the small errors of bodies without contact."""
    # Leaves of one shape are compared elementwise before their maxima are taken. Nothing is
    # gathered into an array, which would keep the loop from becoming one native function.
    largest: dict[tuple[int, ...], Scalar] = {}
    for leaf in jax.tree.leaves(tree):
        shape = jnp.shape(leaf)
        largest[shape] = larger(largest.get(shape, 0.0), jnp.abs(leaf))
    return reduce(jnp.maximum, [jnp.max(leaf) for leaf in largest.values()])


def require_ordinary(solver: diffrax.AbstractSolver) -> None:
    """Raise a `ValueError` unless a solver takes an ordinary differential equation as one term."""
    structure, kind = solver.term_structure, type(solver).__name__
    is_ordinary = isinstance(structure, type) and issubclass(diffrax.ODETerm, structure)
    expected = "a solver of ordinary differential equations without splitting"
    remedy = "take one such as diffrax.Tsit5(), Dopri8() or Kvaerno5()"
    require(is_ordinary, "solver", kind, expected, remedy)


def ready_solver(
    solver: diffrax.AbstractSolver, rtol: float, atol: float
) -> diffrax.AbstractSolver:
    """Return a solver whose method `step` can be called directly, without the preparations that
    `diffrax.diffeqsolve` makes. Explicit Runge-Kutta methods become `UnrolledExplicit`. Other
    Runge-Kutta methods, unless their `scan_kind` is set, loop over their stages by `lax.scan`,
    which forward differentiation supports. Implicit methods iterate their stages to `rtol` and
    `atol`, unless their root finder has tolerances of its own."""
    solver = unrolled(solver)
    if isinstance(solver, diffrax.AbstractRungeKutta) and solver.scan_kind is None:
        solver = replace(solver, scan_kind="lax")
    if isinstance(solver, diffrax.AbstractImplicitSolver):
        # The tolerances and the norm of the default root finder are markers, which only
        # `diffrax.diffeqsolve` replaces by the tolerances and norm of the controller.
        marker = diffrax.with_stepsize_controller_tols(diffrax.VeryChord)().rtol
        usual = {"rtol": rtol, "atol": atol, "norm": largest_component}
        finder = solver.root_finder
        marked = {n: value for n, value in usual.items() if getattr(finder, n, None) is marker}
        solver = replace(solver, root_finder=replace(finder, **marked))
    return solver
