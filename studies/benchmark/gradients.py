"""Derivatives of a run: how accurate each way is, and what it costs, by number of parameters.

The height of arm 2 of the paper's double pendulum (0.5 mm, restitution 0.9) at 0.1 s, five impacts
on, by log c, log K and the restitution, is known to ten digits from an event-exact solver in
quadruple precision. All programs are compiled with their tolerance as an argument; the unit of
time is the compiled run without derivatives, at the same tolerance. "Error-controlled" are the
derivatives of `clearjoint.sensitivities`, here the compiled run alone.
"""

import argparse
import math
import time
from collections.abc import Callable, Hashable
from functools import partial
from typing import Any, TypeVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import clearjoint as cj
from clearjoint.extend import UNIT_Y, ZERO
from clearjoint.testing import compiled_sensitivities
from studies.common.report import Record, report

SPAN, TOLERANCES, COUNTS = 0.1, (1e-6, 1e-8, 1e-9, 1e-10), (1, 10, 20, 100)
"""Simulated time, s; relative tolerances; and numbers of parameters."""
QUICK_SPAN, QUICK_TOLERANCES, QUICK_COUNTS = 0.012, (1e-6,), (1,)
TABLE = {
    0.012: (2.861031385e-4, -2.626347866e-6, -4.567781795e-5),
    0.1: (-3.040991498e-4, 5.228820326e-5, -2.617509723e-3),
}
"""Reference derivatives in m by the end time: by log c (K follows c), log K, restitution."""
LANDING, LOADED_RTOL, COUNTED_RTOL = 1e-13, 1e-8, 1e-9
NOMINAL = (np.log(0.5e-3), np.log(207e9), 0.9)
"""Log clearance, log stiffness, restitution."""
DIFFERENCE = 1e-4
"""Step of the central differences, of the logarithms and of the restitution."""
ESTIMANDS = {
    "log c": cj.Parameter(lambda s: s.joints["shoulder"].clearance, cj.Log()),
    "log K": cj.Parameter(lambda s: s.joints["shoulder"].law.stiffness.young_modulus, cj.Log()),
    "e": cj.Parameter(lambda s: s.joints["shoulder"].law.restitution),
    "mass of arm 2": cj.Parameter(lambda s: s.bodies["arm 2"].mass, cj.Log()),
    "mass of arm 3": cj.Parameter(lambda s: s.bodies["arm 3"].mass, cj.Log()),
    "gravity": cj.Parameter(lambda s: s.gravity[1]),
}
"""What error-controlled derivatives are taken along, the first of them; three are the table's."""
ESTIMAND_COUNTS, QUICK_ESTIMAND_COUNTS = (1, 3, 6), (1,)
DERIVATIVE_TOLERANCES = (10.0, 1e3, 1e5)
"""Of derivatives, in the tolerances of the states; the first is the setting's default."""
REVERSE = diffrax.RecursiveCheckpointAdjoint()
Program = Callable[..., Any]
Way = Callable[[], Any]
Name = TypeVar("Name", bound=Hashable)


def gradients(options: argparse.Namespace) -> None:
    """Measure error and time of derivatives of a run, and what more parameters cost."""
    cj.configure()
    span, tolerances, counts, few = (
        (QUICK_SPAN, QUICK_TOLERANCES, QUICK_COUNTS, QUICK_ESTIMAND_COUNTS)
        if options.quick
        else (SPAN, TOLERANCES, COUNTS, ESTIMAND_COUNTS)
    )
    solver = diffrax.Bosh3() if options.quick else diffrax.Tsit5()
    accuracies = accuracy(span, tolerances, solver, options.repeats)
    report(None, _rows(accuracies), [])
    controlled = attempts(few, span, solver, options.repeats)
    print(f"\nError-controlled, by parameters and their tolerance, rtol {COUNTED_RTOL:g}:\n")
    report(None, _rows(controlled), [])
    costs = [cost(count, span, solver, options.repeats) for count in counts]
    print("\nOf the computed steps, by number of parameters:\n")
    report(options.json, _rows(costs), [*accuracies, *controlled, *costs])


def _rows(records: list[Record]) -> list[tuple[str, ...]]:
    body = [tuple(_cell(value) for value in record.values()) for record in records]
    return [tuple(records[0]), *body]


def _cell(value: Any) -> str:
    return f"{value:.2g}" if isinstance(value, float) else str(value)


def accuracy(
    span: float, tolerances: tuple[float, ...], solver: diffrax.AbstractERK, repeats: int
) -> list[Record]:
    """Relative errors of the three derivatives, and times over the plain run's."""

    def height(parameters: Any, rtol: Any, **options: Any) -> Any:
        return _height(_pendulum(parameters, span, rtol, solver, **options))

    at = jnp.asarray(NOMINAL)
    plain = jax.jit(height)
    forward = jax.jit(jax.jacfwd(height))
    reverse = jax.jit(jax.grad(lambda *a: height(*a, adjoint=REVERSE)))
    records = []
    for rtol in tolerances:
        controlled = controlled_run(3, rtol, span, solver)
        ways: dict[str, Way] = {
            "plain": partial(plain, at, rtol),
            "forward, `jax.jacfwd`": partial(forward, at, rtol),
            "reverse, `jax.grad`": partial(reverse, at, rtol),
            "error-controlled, `cj.sensitivities`": lambda run=controlled: run()[0],
            "central differences": partial(_differences, plain, at, rtol),
        }
        found = _timed(ways, repeats)
        unit, _ = found.pop("plain")
        for name, (seconds, result) in found.items():
            errors = np.abs(np.asarray(result) / TABLE[span] - 1.0)
            columns = zip(("log c", "log K", "e"), map(float, errors), strict=True)
            records.append(
                {"rtol": f"{rtol:g}", "way": name}
                | {f"error by {parameter}": error for parameter, error in columns}
                | {"times the plain run": seconds / unit}
            )
    return records


def controlled_run(
    count: int,
    rtol: float,
    span: float,
    solver: diffrax.AbstractERK,
    tolerance: float = DERIVATIVE_TOLERANCES[0],
) -> Way:
    """The compiled run with derivatives of the height along so many parameters, (p,), and its
    attempts."""
    scene, state = cj.double_pendulum()
    parameters = dict(list(ESTIMANDS.items())[:count])
    height = {"height": cj.quantities.Position("arm 2", "y")}
    settings = cj.Settings(
        solver=solver, rtol=rtol, landing_tolerance=LANDING, derivative_tolerance=tolerance
    )
    run = compiled_sensitivities(scene, state, span, parameters, height, settings)

    def derivatives() -> tuple[Any, Any]:
        found = run()
        return found.derivatives["height"][0], found.attempts

    return derivatives


def attempts(
    counts: tuple[int, ...], span: float, solver: diffrax.AbstractERK, repeats: int
) -> list[Record]:
    """Attempted steps, times of all and of one, and the largest relative error of those derivatives
    that the table has, with so many parameters at each tolerance, and without any."""

    @jax.jit
    def plain(parameters: Any, rtol: Any) -> Any:
        run = _pendulum(parameters, span, rtol, solver)
        return _height(run), run.attempts

    cases = [(count, tolerance) for count in counts for tolerance in DERIVATIVE_TOLERANCES]
    runs: dict[tuple[int, float], Way] = {
        (count, tolerance): controlled_run(count, COUNTED_RTOL, span, solver, tolerance)
        for count, tolerance in cases
    }
    none = 0, 0.0
    runs = {none: partial(plain, jnp.asarray(NOMINAL), COUNTED_RTOL), **runs}
    found = _timed(runs, repeats)
    unit, _ = found[none]
    records = []
    for (count, tolerance), (seconds, (values, tried)) in found.items():
        known = np.atleast_1d(values)[: min(count, len(TABLE[span]))]
        errors = np.abs(known / TABLE[span][: len(known)] - 1.0)
        records.append(
            {
                "parameters": count,
                "their tolerance": f"{tolerance:g}" if count else "",
                "attempts": int(tried),
                "largest error": float(np.max(errors)) if count else "",
                "ms": 1e3 * seconds,
                "µs an attempt": 1e6 * seconds / int(tried),
                "times the plain run": seconds / unit,
            }
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


def cost(count: int, span: float, solver: diffrax.AbstractERK, repeats: int) -> Record:
    """Time and memory of the derivatives by the values of a load at so many times."""
    pendulum, state = cj.double_pendulum()
    at = jnp.zeros(count)

    def height(values: Any, **options: Any) -> Any:
        load = TimedLoad("arm 2", values, span)
        scene = cj.Scene(pendulum.bodies, pendulum.joints, {"load": load}, pendulum.gravity)
        return _height(_simulated(scene, state, span, LOADED_RTOL, solver, **options))

    unit = _least(partial(jax.jit(height), at), repeats)
    record: Record = {"parameters": count, "plain run, ms": 1e3 * unit}
    for name, way in (
        ("forward", jax.jacfwd(height)),
        ("reverse", jax.grad(lambda values: height(values, adjoint=REVERSE))),
    ):
        start = time.perf_counter()
        program = jax.jit(way).lower(at).compile()
        record[f"{name}: first call, s"] = time.perf_counter() - start
        record[f"{name}: times the plain run"] = _least(partial(program, at), repeats) / unit
        record[f"{name}: MB"] = 1e-6 * getattr(program.memory_analysis(), "temp_size_in_bytes", 0)
    return record


def _pendulum(
    parameters: Any, span: float, rtol: Any, solver: diffrax.AbstractERK, **options: Any
) -> cj.Solution:
    """The run at log clearance, log stiffness and restitution."""
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
    return _simulated(scene, state, span, rtol, solver, **options)


def _simulated(
    scene: cj.Scene,
    state: cj.State,
    span: float,
    rtol: Any,
    solver: diffrax.AbstractERK,
    **options: Any,
) -> cj.Solution:
    return cj.simulate(
        scene,
        state,
        span,
        cj.Settings(solver=solver, rtol=rtol, landing_tolerance=LANDING),
        **options,
    )


def _height(run: cj.Solution) -> Any:
    return run.final.bodies["arm 2"].position[1]


def _differences(run: Program, at: Any, rtol: Any) -> np.ndarray:
    steps = DIFFERENCE * np.eye(len(at))
    return np.array([(run(at + h, rtol) - run(at - h, rtol)) / (2 * DIFFERENCE) for h in steps])


def _least(run: Way, repeats: int) -> float:
    return _timed({"": run}, repeats)[""][0]


def _timed(runs: dict[Name, Way], repeats: int) -> dict[Name, tuple[float, Any]]:
    """Of each: the least time of a call after the one that compiles, s, taken in turn; and the
    result."""
    found = {name: jax.block_until_ready(run()) for name, run in runs.items()}
    least = dict.fromkeys(runs, math.inf)
    for _ in range(repeats):
        for name, run in runs.items():
            start = time.perf_counter()
            jax.block_until_ready(run())
            least[name] = min(least[name], time.perf_counter() - start)
    return {name: (least[name], result) for name, result in found.items()}
