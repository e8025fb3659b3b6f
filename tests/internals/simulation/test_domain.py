"""Checks that need known numbers."""

import jax
import jax.numpy as jnp

import clearjoint as cj
from clearjoint._fields.checks import conditions_of, recheck


class Blade(cj.extend.AbstractFriction):
    """A friction whose check needs known numbers."""

    coefficient: float

    def __check_init__(self):
        if self.coefficient < 0.0:
            raise ValueError("negative")

    def ratio(self, slip_speed):
        return self.coefficient * jnp.tanh(slip_speed / 1e-3)


def test_checks_that_need_known_numbers_are_left_out():
    found = jax.eval_shape(lambda blade: conditions_of(lambda: recheck(blade)), Blade(0.1))
    assert found == []
