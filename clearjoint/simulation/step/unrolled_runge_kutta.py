"""Explicit Runge-Kutta steps with their stages written out.

diffrax loops over the stages of a step. Inside the loop it decides whether the last stage of the
previous step can be reused, for all lanes of a batch together. Written out, a step is plain
arithmetic: in a batch it takes a third of the time, and each lane has the numbers of a single run.
Tableaux, error estimates and dense output are diffrax's.

A time map may space the stages of a step non-uniformly in time: see `.time_map`.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import TypeAlias, TypeVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, PyTree

from ...fields.types import Single
from ...math.vectors import Scalar
from ...native import evaluated
from .time_map import AbstractTimeMap

Weights = Float[np.ndarray, " n"]
Y = TypeVar("Y")
"""A PyTree of variables, or of their rates per s."""
DenseInformation: TypeAlias = dict[str, PyTree[Scalar]]
"""Data for the dense output of a step: "y0" and "y1", the variables at its start and end, and
"stages", the rates in each stage (other names for solvers other than `UnrolledExplicit`)."""


class UnrolledExplicit(diffrax.AbstractSolver):
    """A diffrax explicit Runge-Kutta `method` with its stages written out.

    The state of the solver is the rates at the start of the next step. Arguments and results of the
    methods are those of diffrax's `AbstractSolver`.
    """

    method: diffrax.AbstractERK
    term_structure = diffrax.ODETerm

    @property
    def interpolation_cls(self) -> Callable[..., "DenseOutput"]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Function that returns the dense output of a step, with the arguments `t0`, `t1`, s, and
        the items of `DenseInformation`."""
        return self._interpolation

    def _interpolation(
        self, *, t0: Scalar, t1: Scalar, y0: Y, y1: Y, stages: tuple[Y, ...]
    ) -> "DenseOutput":
        del y1
        return DenseOutput(self.method, t0, t1, y0, stages)

    def order(self, terms: diffrax.ODETerm) -> int | None:
        """Return the order of the wrapped method's solution."""
        return self.method.order(terms)

    def error_order(self, terms: diffrax.ODETerm) -> Single | None:
        """Return the order of the wrapped method's error estimate."""
        return self.method.error_order(terms)

    def func(self, terms: diffrax.ODETerm, t0: Scalar, y0: Y, args: PyTree) -> Y:
        """Return the rates of the variables `y0` at the time `t0`, s."""
        return terms.vf(t0, y0, args)

    def init(self, terms: diffrax.ODETerm, t0: Scalar, t1: Scalar, y0: Y, args: PyTree) -> Y:
        """Return the solver's state before the first step: the rates at `t0`, s."""
        del t1
        return terms.vf(t0, y0, args)

    def information_like(self, y: Y) -> DenseInformation:
        """Return data for dense output of the same structure as those of a step of `y`."""
        return {"y0": y, "y1": y, "stages": (y,) * self.method.tableau.num_stages}

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
        """Compute one step from `t0` to `t1`, s.

        **Arguments:** `y0`: variables at `t0`; `solver_state`: the rates at `t0`, reused only if
        `made_jump` is the Python value ``False``; `time_map`: how time passes in the step,
        uniformly if ``None``.

        **Returns:** the variables at `t1`, the error estimate, the data for dense output, the rates
        at `t1`, and diffrax's result code.
        """
        tableau = _tableau(self.method)
        h = t1 - t0
        # Only the Python value False is tested: a traced condition would have to evaluate both
        # branches in every lane, so the rates are then computed unconditionally.
        last = solver_state if made_jump is False else terms.vf(t0, y0, args)
        # With a time map the independent variable is the fraction x of the step. Its nodes are
        # those of the tableau, and dy/dx = dy/dt dt/dx.
        stages, y = [_rates_by_fraction(last, 0.0, time_map)], y0
        for row, fraction in zip(tableau.a_lower, tableau.c, strict=True):
            y = _advanced(y0, h, row, stages)
            elapsed = fraction if time_map is None else time_map.elapsed(fraction)
            # The last stage is at exactly t1; t0 + h may differ from it by rounding.
            t = t1 if fraction == 1.0 else t0 + elapsed * h
            last = terms.vf(t, y, args)
            stages.append(_rates_by_fraction(last, fraction, time_map))
        y1 = y if tableau.ssal else _advanced(y0, h, tableau.b_sol, stages)
        # "First same as last": the last stage was evaluated at the end of the step.
        if not tableau.fsal:
            last = terms.vf(t1, y1, args)
        error = jax.tree.map(
            lambda *rates: h * _weighted(tableau.b_error, rates),
            *stages,
        )
        information = {"y0": y0, "y1": y1, "stages": tuple(stages)}
        return y1, error, information, last, diffrax.RESULTS.successful


class DenseOutput(eqx.Module):
    """Dense output of a step from `t0` to `t1`, s, in scalar form; the polynomials are diffrax's.

    Sums over the stages are written out. A reduction of an array would be a loop between scalar
    operations, and XLA's emitter repeats expressions that it has emitted before a loop at each use
    after the loop. One derivative of one acceleration of the double pendulum had 59 MB of LLVM text
    and never compiled; without reductions it has 11 MB.

    **Arguments:** `y0`: variables at `t0`; `stages`: rates in each stage, times the slope of the
    time map.
    """

    method: diffrax.AbstractERK
    t0: Scalar
    t1: Scalar
    y0: PyTree[Scalar]
    stages: tuple[PyTree[Scalar], ...]

    def evaluate(self, t: Scalar) -> PyTree[Scalar]:
        """Return the variables at the time t, s, as if time were uniform in the step; see
        `dense_time`."""
        h = self.t1 - self.t0
        return self.at((t - self.t0) / jnp.where(h > 0.0, h, 1.0))

    def at(self, x: Scalar) -> PyTree[Scalar]:
        """Return the variables at the fraction x of the step, 0 to 1."""
        h = self.t1 - self.t0
        weights = [h * _horner(row, x) for row in dense_weights(self.method)]

        def leaf(y0: Scalar, *stages: Scalar) -> Scalar:
            for weight, stage in zip(weights, stages, strict=True):
                y0 = y0 + weight * stage
            return y0

        return jax.tree.map(leaf, self.y0, *self.stages)


def _rates_by_fraction(rates: Y, x: float, time_map: AbstractTimeMap | None) -> Y:
    """Return derivatives of the variables by the fraction x of the step, over the step's length:
    `rates` at x times the slope of the time map."""
    if time_map is None:
        return rates
    slope = time_map.slope(x)
    return jax.tree.map(lambda rate: slope * rate, rates)


def _tableau(method: diffrax.AbstractERK) -> diffrax.ButcherTableau:
    assert isinstance(method.tableau, diffrax.ButcherTableau)
    return method.tableau


def _advanced(y0: Y, h: Scalar, weights: Weights, stages: Sequence[Y]) -> Y:
    """Return y0 + h sum of w_i f_i over the weights w and the stages f."""
    return jax.tree.map(lambda y, *rates: y + h * _weighted(weights, rates), y0, *stages)


def _weighted(weights: Weights, values: Sequence[Scalar]) -> Scalar:
    terms = [float(w) * value for w, value in zip(weights, values, strict=True) if w != 0.0]
    return sum(terms[1:], terms[0])


def unrolled(solver: diffrax.AbstractSolver) -> diffrax.AbstractSolver:
    """Return the solver as `UnrolledExplicit` if it is an explicit Runge-Kutta method; otherwise
    unchanged."""
    if isinstance(solver, diffrax.AbstractERK) and isinstance(
        solver.tableau, diffrax.ButcherTableau
    ):
        return UnrolledExplicit(solver)
    return solver


def _horner(coefficients: Weights, x: Scalar) -> Scalar:
    """Return a polynomial at x. The first coefficient is that of power 0, which must be zero."""
    value: Scalar = float(coefficients[-1])
    for coefficient in coefficients[-2:0:-1]:
        value = value * x + float(coefficient)
    return value * x


@cache
def dense_weights(method: diffrax.AbstractERK) -> Float[np.ndarray, "stages powers"]:
    """Return the polynomials b_i of the dense output y0 + h sum b_i(x) f_i over the stages f_i.

    The polynomials do not depend on the step. diffrax's interpolant is linear in the stages, so it
    is evaluated for unit stages at Chebyshev nodes x. The operations of the interpolant are
    executed one by one: a compiler would fuse them, and the digits would differ between processors.

    **Returns:** the coefficients, (stages, degree + 1), lowest power of x first, where x is the
    fraction of the step.
    """
    tableau = _tableau(method)
    stages = tableau.num_stages
    degree = max(method.order(None) or 1, 3)
    x = 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree)

    def value(t0: Scalar, t1: Scalar, y1: Scalar, k: jax.Array, t: Scalar) -> Scalar:
        return method.interpolation_cls(t0=t0, t1=t1, y0=0.0 * y1, y1=y1, k=k).evaluate(t)

    # With a step of length 1 from 0, unit stage i leads to y1 = b_sol[i].
    b, unit = np.asarray(tableau.b_sol), np.eye(stages)
    rows = zip(b, unit, strict=True)
    calls = [(0.0, 1.0, *row, t) for row in rows for t in x]
    numbers = evaluated(value, calls)
    if numbers is not None:
        values = np.reshape(numbers, (stages, len(x))).T
    else:
        with jax.ensure_compile_time_eval():
            y1, k = map(jax.device_put, (b, unit))
            values = np.array([value(0.0, 1.0, y1, k, t) for t in x])
    return np.linalg.solve(np.vander(x, increasing=True), values).T
