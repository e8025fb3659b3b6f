"""Checks of lanes and of known numbers warn of nothing again."""

import warnings

import jax
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._fields.checks import recheck
from clearjoint._sweeps.axes import lanes_of


def test_repeated_checks_and_traced_numbers_give_no_warning():
    """Neither the checks of a run, nor lanes of a sweep, nor traced numbers."""
    with pytest.warns(cj.UnusualValueWarning):
        soft = cj.laws.RavnStiffness(207, 0.3)
    scene, state = cj.mechanisms.double_pendulum(law=cj.laws.Hertz(soft))
    change = cj.Axis.change(lambda scene, state, m: (_with_mass(scene, m), state), [7e3, 8e3])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        recheck(scene)
        lanes = lanes_of(scene, state, {"mass": change}, {"mass": np.array([7e3, 8e3])})
        jax.jit(lambda modulus: cj.laws.RavnStiffness(modulus, 0.3).young_modulus)(207.0)
        jax.vmap(lambda mass: cj.Body(mass, (1.0, 1.0, 1.0)).mass)(np.array([1e9, 1e10]))
    assert not lanes.bad


def _with_mass(scene, mass):
    arm = cj.Body(mass, (0.0010, 0.5855, 0.5855))
    return cj.Scene({**scene.bodies, "arm 2": arm}, scene.joints, gravity=scene.gravity)
