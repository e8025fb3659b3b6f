"""Runs in native code against the same runs compiled by XLA."""

import re
import warnings
from pathlib import Path
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint import _native as native
from clearjoint import extend
from clearjoint._compilation.xla import Compiled
from clearjoint._native import NativeFallbackWarning
from clearjoint._native.compiled import _reported
from tests.support.one_body import one_body
from tests.support.oscillator import on_spring
from tests.support.slow import slow_but

SPRUNG = on_spring("mass")
SPEED = cj.quantities.Velocity("mass", "x")
X = {"x": cj.quantities.Position("mass", "x")}


def stiffness(scene: cj.Scene) -> Any:
    return scene.forces["spring"].stiffness


def runs(*settings: cj.Settings, save: cj.Saving | None = None, outputs: Any = None):
    """Return a call that simulates the spring with each of the settings."""

    def call():
        for own in settings:
            cj.simulate(*SPRUNG, 0.01, own, save, outputs=outputs, progress=False)

    return call


def observe():
    save = cj.Saving(np.linspace(0.0, 0.01, 3))
    return cj.observe(SPRUNG[0], cj.simulate(*SPRUNG, 0.01, save=save, progress=False))


def swept():
    axes = {"stiffness": cj.Axis(stiffness, [100.0, 200.0])}
    cj.sweep(*SPRUNG, 0.01, axes, progress=False)


def differentiated():
    parameters = {"k": cj.Parameter(stiffness, cj.Log())}
    cj.sensitivities(*SPRUNG, 0.01, parameters, X, [0.01], progress=False)


def in_reverse():
    predict = cj.predictor(*SPRUNG, 0.01, {"k": stiffness}, X, [0.01])
    jax.jit(jax.grad(lambda values: predict(values)["x"][0]))(predict.values)


def inside_of_jit():
    def end(number):
        scene = cj.set_value(SPRUNG[0], stiffness, number)
        run = cj.simulate(scene, SPRUNG[1], 0.01, throw=False, progress=False)
        return run.final.bodies["mass"].position

    return jax.jit(end)(100.0)


EXPLICIT = [diffrax.Heun(), diffrax.Bosh3(), diffrax.Dopri5(), diffrax.Dopri8()]
CALLS = {
    "`simulate` with joint or absolute coordinates, any stabilisation, the energy ledger": runs(
        cj.Settings(),
        cj.Settings(coordinates=cj.AbsoluteCoordinates(), stabilisation=cj.Projection()),
        cj.Settings(stabilisation=cj.Unstabilised(), ledger=True),
    ),
    "`simulate` with states, steps, impacts and outputs saved": runs(
        cj.Settings(),
        save=cj.Saving([0.0, 0.005], steps=True, impacts=True),
        outputs={"speed": SPEED, "zero": cj.Section(SPEED, {"speed": (SPEED, "m/s")}, count=2)},
    ),
    "`simulate` with an explicit solver, or a controller of diffrax": runs(
        *(cj.Settings(solver=solver) for solver in EXPLICIT),
        cj.Settings(controller=diffrax.PIDController(1e-6, 1e-9)),
        cj.Settings(controller=diffrax.ConstantStepSize(), first_step=1e-3),
    ),
    "`simulate` with an implicit solver": runs(cj.Settings(solver=diffrax.Kvaerno5(), atol=1e-9)),
    "`sweep`": swept,
    "`sensitivities`": differentiated,
    "`predictor` and its gradients, also called inside of `jax.jit`, `jax.vmap` or `jax.grad`": (
        in_reverse
    ),
    "`simulate_nonsmooth`": lambda: cj.simulate_nonsmooth(
        *cj.mechanisms.double_pendulum(), 1e-3, restitution=0.5, step=1e-4
    ),
    "`observe`": observe,
    "`free_impact`": lambda: cj.free_impact(cj.laws.Hertz(1e6), 1.0, 0.1),
    "other calls inside of `jax.jit`, `jax.vmap` or `jax.grad`": inside_of_jit,
}
FAST = (
    "`simulate` with joint or absolute coordinates, any stabilisation, the energy ledger",
    *("`sweep`", "`sensitivities`"),
)
"""The others compile for seconds."""
README = Path(native.__file__).with_name("README.md").read_text(encoding="utf-8")
TABLE = dict(re.findall(r"^\| (.*) \| (LLVM|XLA) \|$", README, re.MULTILINE))


def test_the_table_of_native_calls_is_complete():
    assert list(TABLE) == list(CALLS)


@pytest.mark.parametrize("name", slow_but(FAST, CALLS))
def test_the_table_is_correct(name, monkeypatch):
    by_xla = []

    def recorded(self, *arguments, called=Compiled.__call__, **options):
        by_xla.append(self.__wrapped__.__qualname__)
        return called(self, *arguments, **options)

    _reported.clear()
    monkeypatch.setattr(Compiled, "__call__", recorded)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NativeFallbackWarning)
        CALLS[name]()
    assert bool(by_xla) == (TABLE[name] == "XLA"), by_xla


class Eigenforce(cj.extend.AbstractForce):
    """A force with a matrix decomposition, for which native code has no rule."""

    body: str

    def body_names(self):
        return (self.body,)

    def wrenches(self, motions, t):
        least = jnp.linalg.eigvalsh(jnp.array([[2.0, t], [t, 2.0]]))[0]
        return {
            self.body: motions[self.body].wrench(cj.extend.Vector(least, 0.0, 0.0), extend.ZERO)
        }


def test_xla_compiles_a_primitive_without_a_rule_with_one_warning():
    """The exact motion is 2 - t."""
    _reported.clear()
    pushed = one_body("mass", forces={"force": Eigenforce("mass")}, position=(0.1, 0.0, 0.0))
    with pytest.warns(NativeFallbackWarning, match=r"no native code for .*test_scenes.py") as seen:
        solution = cj.simulate(*pushed, 0.5, progress=False)
    assert len([w for w in seen if w.category is NativeFallbackWarning]) == 1
    x = solution.final.bodies["mass"].position[0]
    assert x == pytest.approx(0.1 + 0.5**2 - 0.5**3 / 6, abs=1e-9)
