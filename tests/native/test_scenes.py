"""Runs in native code against the same runs compiled by XLA."""

import warnings

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint import extend
from clearjoint.native import NativeFallbackWarning
from clearjoint.native.compiled import SWITCH, _reported

SPRING = cj.SpringDamper("ground", "mass", (0, 0, 0), (0, 0, 0), stiffness=100.0)
FINE = cj.Settings(rtol=1e-10)
STATE = cj.State({"mass": cj.body_state((0.1, 0.0, 0.0))})
MECHANISMS = {
    "double pendulum": lambda: cj.double_pendulum(),
    "with friction that sticks": lambda: cj.double_pendulum(friction=cj.LuGre(0.2, 0.1, 0.01)),
    "slider-crank": lambda: cj.slider_crank(0.1e-3),
    "four-bar": lambda: cj.four_bar(
        {"crank pin": 0.1e-3, "rocker foot": 0.2e-3},
        speed=10.0,
        friction=cj.RegularisedCoulomb(0.1),
    ),
    "rotor": lambda: cj.rotor_in_bearing(),
    "gear pair": lambda: cj.gear_pair(),
}


def mass_on(*forces: cj.AbstractForce) -> cj.Scene:
    named = {f"force {k}": force for k, force in enumerate(forces)}
    return cj.Scene({"mass": cj.Body(1.0, (1.0, 1.0, 1.0))}, forces=named)


def both(monkeypatch, call):
    """A call in native code, which must not fall back, and by XLA."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", NativeFallbackWarning)
        native = call()
    monkeypatch.setenv(SWITCH, "0")
    return native, call()


def assert_close(one, other, tolerance):
    np.testing.assert_allclose(one, other, rtol=0.0, atol=tolerance)


def test_a_spring_moves_as_by_xla(monkeypatch):
    save = cj.Saving(np.linspace(0.0, 1.0, 80), steps=True)
    native, xla = both(
        monkeypatch, lambda: cj.simulate(mass_on(SPRING), STATE, 1.0, save=save, progress=False)
    )
    assert native.attempts == xla.attempts
    for ours, theirs in ((native.saved, xla.saved), (native.steps, xla.steps)):
        for one, other in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
            assert_close(one, other, 1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("name", MECHANISMS)
def test_mechanisms_move_as_by_xla(name, monkeypatch):
    """Up to 20 ms, before chaos makes differences of roundings grow."""
    scene, state = MECHANISMS[name]()
    save = cj.Saving(np.linspace(0.0, 0.02, 5), impacts=True)
    native, xla = both(
        monkeypatch, lambda: cj.simulate(scene, state, 0.02, FINE, save=save, progress=False)
    )
    ours, theirs = native.saved.states.bodies, xla.saved.states.bodies
    for body in ours:
        assert_close(ours[body].position, theirs[body].position, 1e-9)
        assert_close(ours[body].velocity, theirs[body].velocity, 1e-5)
    assert_close(native.impacts.onset, xla.impacts.onset, 1e-8)


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        cj.Settings(coordinates=cj.AbsoluteCoordinates()),
        cj.Settings(solver=diffrax.Dopri8(), rtol=1e-9),
        cj.Settings(solver=diffrax.Heun()),
        cj.Settings(ledger=True),
    ],
    ids=["absolute", "Dopri8", "Heun", "ledger"],
)
def test_settings_give_the_motion_that_xla_gives(settings, monkeypatch):
    scene, state = cj.double_pendulum()
    native, xla = both(
        monkeypatch, lambda: cj.simulate(scene, state, 0.02, settings, progress=False)
    )
    for name, body in native.final.bodies.items():
        assert_close(body.position, xla.final.bodies[name].position, 1e-9)


class Eigenforce(cj.AbstractForce):
    """A force by a decomposition that native code has no rule for."""

    body: str

    def body_names(self):
        return (self.body,)

    def wrenches(self, motions, t):
        least = jnp.linalg.eigvalsh(jnp.array([[2.0, t], [t, 2.0]]))[0]
        return {self.body: motions[self.body].wrench(cj.Vector(least, 0.0, 0.0), extend.ZERO)}


def test_a_primitive_without_a_rule_is_named_once_and_left_to_xla():
    """2 - t in the closed form."""
    _reported.clear()
    with pytest.warns(NativeFallbackWarning, match=r"no native code for .*test_scenes.py") as seen:
        solution = cj.simulate(mass_on(Eigenforce("mass")), STATE, 0.5, progress=False)
    assert len([w for w in seen if w.category is NativeFallbackWarning]) == 1
    x = solution.final.bodies["mass"].position[0]
    assert x == pytest.approx(0.1 + 0.5**2 - 0.5**3 / 6, abs=1e-9)
