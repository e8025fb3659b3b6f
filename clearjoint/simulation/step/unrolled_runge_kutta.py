"""Explicit Runge-Kutta steps with their stages written out.

diffrax loops over the stages and decides inside the loop, by looking at all lanes of a batch,
whether the last stage of the step before may be used again. Written out, a step is plain
arithmetic: in a batch it takes a third of the time, and no lane sees another, so that its numbers
do not depend on who runs beside it. Tableaux, error estimates and dense output are diffrax's.

Time may pass unevenly in a step: see `.time_map`.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import TypeVar

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
from .types import DenseInformation

Weights = Float[np.ndarray, " n"]
Y = TypeVar("Y")
"""A PyTree of variables, or of their rates."""


class UnrolledExplicit(diffrax.AbstractSolver):
    """The steps of a diffrax explicit Runge-Kutta method, stages written out.

    Its state holds the rates at the start of the next step.
    """

    method: diffrax.AbstractERK
    term_structure = diffrax.ODETerm

    @property
    def interpolation_cls(self) -> Callable[..., "DenseOutput"]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """What makes the dense output of a step, as diffrax asks for it."""
        return self._interpolation

    def _interpolation(
        self, *, t0: Scalar, t1: Scalar, y0: Y, y1: Y, stages: tuple[Y, ...]
    ) -> "DenseOutput":
        del y1
        return DenseOutput(self.method, t0, t1, y0, stages)

    def order(self, terms: diffrax.ODETerm) -> int | None:
        """Order of the wrapped method's solution."""
        return self.method.order(terms)

    def error_order(self, terms: diffrax.ODETerm) -> Single | None:
        """Order of the wrapped method's error estimate."""
        return self.method.error_order(terms)

    def func(self, terms: diffrax.ODETerm, t0: Scalar, y0: Y, args: PyTree) -> Y:
        """The rates of the variables at a time."""
        return terms.vf(t0, y0, args)

    def init(self, terms: diffrax.ODETerm, t0: Scalar, t1: Scalar, y0: Y, args: PyTree) -> Y:
        """The solver's state before the first step: the rates there."""
        del t1
        return terms.vf(t0, y0, args)

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
        """One step; the rates at its start are computed anew unless `made_jump` is ``False``."""
        tableau = _tableau(self.method)
        h = t1 - t0
        last = solver_state if made_jump is False else terms.vf(t0, y0, args)
        stages, y = [_per_place(last, 0.0, time_map)], y0
        for row, fraction in zip(tableau.a_lower, tableau.c, strict=True):
            y = _advanced(y0, h, row, stages)
            t = t1 if fraction == 1.0 else t0 + _elapsed(fraction, time_map) * h
            last = terms.vf(t, y, args)
            stages.append(_per_place(last, fraction, time_map))
        y1 = y if tableau.ssal else _advanced(y0, h, tableau.b_sol, stages)
        if not tableau.fsal:
            last = terms.vf(t1, y1, args)
        error = jax.tree.map(
            lambda *rates: h * _weighted(tableau.b_error, rates),
            *stages,
        )
        information = {"y0": y0, "y1": y1, "stages": tuple(stages)}
        return y1, error, information, last, diffrax.RESULTS.successful


class DenseOutput(eqx.Module):
    """diffrax's dense output of a step, in scalar form.

    Its sums over the stages are written out. A reduction of an array would be a loop in the midst
    of arithmetic, and at each loop XLA's emitter forgets what it has written before: what an
    acceleration, say, takes of many variables it then wrote again at every use. One derivative of
    one acceleration of the double pendulum came to 59 MB of LLVM text, now 11, and never compiled.
    """

    method: diffrax.AbstractERK
    t0: Scalar
    t1: Scalar
    y0: PyTree[Scalar]
    stages: tuple[PyTree[Scalar], ...]

    def evaluate(self, t: Scalar) -> PyTree[Scalar]:
        """The variables at a time within the step, s."""
        h = self.t1 - self.t0
        return self.at((t - self.t0) / jnp.where(h > 0.0, h, 1.0))

    def at(self, x: Scalar) -> PyTree[Scalar]:
        """The variables at a fraction x of the step."""
        h = self.t1 - self.t0
        weights = [h * _horner(row, x) for row in dense_weights(self.method)]

        def leaf(y0: Scalar, *stages: Scalar) -> Scalar:
            for weight, stage in zip(weights, stages, strict=True):
                y0 = y0 + weight * stage
            return y0

        return jax.tree.map(leaf, self.y0, *self.stages)


def _elapsed(place: float, time_map: AbstractTimeMap | None) -> Scalar:
    """The part of a step's time that has passed at a place in it."""
    return place if time_map is None else time_map.elapsed(place)


def _per_place(rates: Y, place: float, time_map: AbstractTimeMap | None) -> Y:
    """Rates against the place in the step, over its length."""
    if time_map is None:
        return rates
    slope = time_map.slope(place)
    return jax.tree.map(lambda rate: slope * rate, rates)


def _tableau(method: diffrax.AbstractERK) -> diffrax.ButcherTableau:
    assert isinstance(method.tableau, diffrax.ButcherTableau)
    return method.tableau


def _advanced(y0: Y, h: Scalar, weights: Weights, stages: Sequence[Y]) -> Y:
    return jax.tree.map(lambda y, *rates: y + h * _weighted(weights, rates), y0, *stages)


def _weighted(weights: Weights, values: Sequence[Scalar]) -> Scalar:
    terms = [float(w) * value for w, value in zip(weights, values, strict=True) if w != 0.0]
    return sum(terms[1:], terms[0])


def unrolled(solver: diffrax.AbstractSolver) -> diffrax.AbstractSolver:
    """The solver with its stages written out, if it is an explicit Runge-Kutta method."""
    if isinstance(solver, diffrax.AbstractERK) and isinstance(
        solver.tableau, diffrax.ButcherTableau
    ):
        return UnrolledExplicit(solver)
    return solver


def _horner(coefficients: Weights, x: Scalar) -> Scalar:
    """A polynomial without constant term, lowest power first."""
    value: Scalar = float(coefficients[-1])
    for coefficient in coefficients[-2:0:-1]:
        value = value * x + float(coefficient)
    return value * x


@cache
def dense_weights(method: diffrax.AbstractERK) -> Float[np.ndarray, "stages powers"]:
    """Polynomials b_i of the dense output y0 + h sum b_i(x) f_i over the stages.

    Shape (stages, degree + 1), lowest power first; x is the fraction of the step. They are read off
    diffrax's interpolant, which is linear in the stages: of as many variables, with one stage each.
    Its operations are carried out one by one, so that no compiler fuses them and the digits are the
    same on every processor.
    """
    tableau = _tableau(method)
    stages = tableau.num_stages
    degree = max(method.order(None) or 1, 3)
    x = 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree)

    def value(t0: Scalar, t1: Scalar, y1: Scalar, k: jax.Array, place: Scalar) -> Scalar:
        return method.interpolation_cls(t0=t0, t1=t1, y0=0.0 * y1, y1=y1, k=k).evaluate(place)

    b, unit = np.asarray(tableau.b_sol), np.eye(stages)
    rows = zip(b, unit, strict=True)
    calls = [(0.0, 1.0, *row, place) for row in rows for place in x]
    numbers = evaluated(value, calls)
    if numbers is not None:
        values = np.reshape(numbers, (stages, len(x))).T
    else:
        with jax.ensure_compile_time_eval():
            y1, k = map(jax.device_put, (b, unit))
            values = np.array([value(0.0, 1.0, y1, k, place) for place in x])
    return np.linalg.solve(np.vander(x, increasing=True), values).T
