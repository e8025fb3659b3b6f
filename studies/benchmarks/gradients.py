"""Derivatives of a run: how accurate each way is, and what it costs, by number of parameters.

The height of arm 2 of the paper's double pendulum (0.5 mm, restitution 0.9) at 0.1 s, five impacts
on, by log c, log K and the restitution, is known to ten digits from an event-exact solver in
quadruple precision. All programs are compiled with their tolerance as an argument; the unit of
time is the compiled run without derivatives, at the same tolerance.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import clearjoint as cj
from clearjoint.vectors import UNIT_Y, ZERO
from studies.benchmarks.report import Record, report

SPAN, TOLERANCES, COUNTS = 0.1, (1e-6, 1e-8, 1e-9, 1e-10), (1, 10, 20, 100)
"""Simulated time, s; relative tolerances; and numbers of parameters."""
QUICK_SPAN, QUICK_TOLERANCES, QUICK_COUNTS = 0.012, (1e-6,), (1,)
TABLE = {
    0.012: (2.861031385e-4, -2.626347866e-6, -4.567781795e-5),
    0.1: (-3.040991498e-4, 5.228820326e-5, -2.617509723e-3),
}
"""Reference derivatives in m by the end time: by log c (K follows c), log K, restitution."""
LANDING, COUNTED_RTOL = 1e-13, 1e-8
DIFFERENCE = 1e-4
"""Step of the central differences, of the logarithms and of the restitution."""
REVERSE = diffrax.RecursiveCheckpointAdjoint()
Program = Callable[..., Any]


def gradients(options: argparse.Namespace) -> None:
    """Measure error and time of derivatives of a run, and what 1, 10, 20, 100 parameters cost."""
    cj.configure()
    span, tolerances, counts = (
        (QUICK_SPAN, QUICK_TOLERANCES, QUICK_COUNTS)
        if options.quick
        else (SPAN, TOLERANCES, COUNTS)
    )
    solver = diffrax.Bosh3() if options.quick else diffrax.Tsit5()
    accuracies = accuracy(span, tolerances, solver, options.repeats)
    report(None, _rows(accuracies), [])
    costs = [cost(count, span, solver, options.repeats) for count in counts]
    print("\nBy number of parameters:\n")
    report(options.json, _rows(costs), [*accuracies, *costs])


def _rows(records: list[Record]) -> list[tuple[str, ...]]:
    body = [tuple(_cell(value) for value in record.values()) for record in records]
    return [tuple(records[0]), *body]


def _cell(value: Any) -> str:
    return f"{value:.2g}" if isinstance(value, float) else str(value)


def accuracy(
    span: float, tolerances: tuple[float, ...], solver: diffrax.AbstractSolver, repeats: int
) -> list[Record]:
    """Relative errors of the three derivatives, and times over the plain run's."""

    def height(parameters: Any, rtol: Any, **options: Any) -> Any:
        log_clearance, log_modulus, restitution = parameters
        scene, state = cj.double_pendulum()
        scene = eqx.tree_at(
            lambda s: (
                s.joints["shoulder"].clearance,
                s.joints["shoulder"].law.stiffness.young_modulus,
                s.joints["shoulder"].law.restitution,
            ),
            scene,
            (jnp.exp(log_clearance), jnp.exp(log_modulus), restitution),
        )
        return _height(scene, state, span, rtol, solver, **options)

    at = jnp.asarray([np.log(0.5e-3), np.log(207e9), 0.9])
    plain = jax.jit(height)
    ways: dict[str, Program] = {
        "forward, `jax.jacfwd`": jax.jit(jax.jacfwd(height)),
        "reverse, `jax.grad`": jax.jit(jax.grad(lambda *a: height(*a, adjoint=REVERSE))),
        "central differences": lambda p, rtol: _differences(plain, p, rtol),
    }
    records = []
    for rtol in tolerances:
        unit, _ = _timed(plain, repeats, at, rtol)
        for name, way in ways.items():
            seconds, found = _timed(way, repeats, at, rtol)
            errors = np.abs(np.asarray(found) / TABLE[span] - 1.0)
            columns = zip(("log c", "log K", "e"), map(float, errors), strict=True)
            records.append(
                {"rtol": f"{rtol:g}", "way": name}
                | {f"error by {parameter}": error for parameter, error in columns}
                | {"times the plain run": seconds / unit}
            )
    return records


class TimedLoad(cj.AbstractForce):
    """A load on a body along Y through its centre of mass, linear in time between given values."""

    body: str = eqx.field(static=True)
    values: Any
    span: float

    def body_names(self) -> tuple[str, ...]:
        """The body."""
        return (self.body,)

    def wrenches(self, motions: Any, t: Any) -> Any:
        """The load at a time, N."""
        places = jnp.arange(self.values.size)
        distance = jnp.abs(t / self.span * self.values.size - places)
        load = jnp.sum(self.values * jnp.maximum(1.0 - distance, 0.0))
        return {self.body: motions[self.body].wrench(UNIT_Y * load, ZERO)}


def cost(count: int, span: float, solver: diffrax.AbstractSolver, repeats: int) -> Record:
    """Time and memory of the derivatives by the values of a load at so many times."""
    pendulum, state = cj.double_pendulum()
    at = jnp.zeros(count)

    def height(values: Any, **options: Any) -> Any:
        load = TimedLoad("arm 2", values, span)
        scene = cj.Scene(pendulum.bodies, pendulum.joints, {"load": load}, pendulum.gravity)
        return _height(scene, state, span, COUNTED_RTOL, solver, **options)

    unit, _ = _timed(jax.jit(height), repeats, at)
    record: Record = {"parameters": count, "plain run, ms": 1e3 * unit}
    for name, way in (
        ("forward", jax.jacfwd(height)),
        ("reverse", jax.grad(lambda values: height(values, adjoint=REVERSE))),
    ):
        start = time.perf_counter()
        program = jax.jit(way).lower(at).compile()
        record[f"{name}: first call, s"] = time.perf_counter() - start
        record[f"{name}: times the plain run"] = _timed(program, repeats, at)[0] / unit
        record[f"{name}: MB"] = 1e-6 * getattr(program.memory_analysis(), "temp_size_in_bytes", 0)
    return record


def _height(
    scene: cj.Scene,
    state: cj.State,
    span: float,
    rtol: Any,
    solver: diffrax.AbstractSolver,
    **options: Any,
) -> Any:
    solution = cj.simulate(
        scene, state, span, rtol=rtol, solver=solver, landing_tolerance=LANDING, **options
    )
    return solution.final.bodies["arm 2"].position[1]


def _differences(run: Program, at: Any, rtol: Any) -> np.ndarray:
    steps = DIFFERENCE * np.eye(len(at))
    return np.array([(run(at + h, rtol) - run(at - h, rtol)) / (2 * DIFFERENCE) for h in steps])


def _timed(program: Program, repeats: int, *arguments: Any) -> tuple[float, Any]:
    """Least time of a call after the one that compiles, s; and the result."""
    found = jax.block_until_ready(program(*arguments))
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(program(*arguments))
        seconds.append(time.perf_counter() - start)
    return min(seconds), found
