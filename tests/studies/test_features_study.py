"""The ladder of features, its guard of absent ones, and the planar programs beside spatial ones."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint.dynamics.formulation import Formulation
from clearjoint.dynamics.system import System
from clearjoint.math.vectors import fold_constants, pack, unpack
from studies.common.operations import jaxpr_operations
from studies.features.__main__ import main
from studies.features.planar import planar_pendulum, slider_crank_rates, without_motor
from studies.features.rungs import LADDER
from tests.support.replaced_code import FEATURES, without

FORMULATION = Formulation()
NAMES = list(LADDER)
FAST = 3
"""Rungs whose programs are traced in no time."""


def of_rungs(places):
    return [
        pytest.param(place, marks=[pytest.mark.slow] if place > FAST else [], id=NAMES[place])
        for place in places
    ]


@pytest.mark.parametrize("place", of_rungs(range(len(LADDER) - 1)))
def test_program_is_the_same_without_the_code_of_the_features_above(place):
    """Word by word, and nothing of them is called."""
    make = LADDER[NAMES[place]]
    text = make().text()
    with without(*list(FEATURES)[place:]):
        assert make().text() == text


@pytest.mark.parametrize("place", of_rungs(range(1, len(LADDER))))
def test_program_needs_the_code_of_its_own_feature(place):
    feature = list(FEATURES)[place - 1]
    with without(feature), pytest.raises(AssertionError, match="lacks"):
        LADDER[NAMES[place]]().text()


@pytest.mark.parametrize(
    "changed", [lambda scene: scene, without_motor], ids=["driven", "coasting"]
)
def test_slider_crank_by_hand_has_the_general_rates(changed):
    scene, state = cj.mechanisms.slider_crank()
    scene = unpack(fold_constants(changed(scene)))
    start = FORMULATION.coordinates.encode(scene, unpack(state.bodies))
    entry_speeds = {"slider pin": {base: jnp.asarray(0.1) for base in "VW"}}

    @jax.jit
    def both(variables):
        arguments = System(scene, FORMULATION), variables, entry_speeds, jnp.asarray(0.01)
        return System.rates(*arguments)[0], slider_crank_rates(*arguments)[0]

    generator, pressed = np.random.default_rng(0), 0
    for _ in range(8):
        variables = jax.tree.map(
            lambda value: value + generator.normal() * (6e-4 if abs(value) < 1.0 else 50.0), start
        )
        general, by_hand = (np.array(jax.tree.leaves(rates)) for rates in both(variables))
        np.testing.assert_allclose(by_hand, general, rtol=1e-7, atol=1e-9)
        pressed += abs(general[-1]) > 1.0
    assert 0 < pressed < 8


def test_body_held_in_a_plane_accelerates_as_one_that_is_free():
    """A turn of a joint that also slides is about the parent's point."""
    (free, start), (held, _) = planar_pendulum(False), planar_pendulum(True)
    free, held = unpack(fold_constants(free)), unpack(fold_constants(held))
    coordinates = FORMULATION.coordinates
    entry_speeds = {"shoulder": {base: jnp.asarray(0.1) for base in "VW"}}

    def accelerations(scene, variables):
        rates, _ = System(scene, FORMULATION).rates(variables, entry_speeds, 0.0)
        rates = jax.tree.map(jnp.asarray, rates)

        def velocities(variables):
            motions = coordinates.motions(scene, variables)
            return [pack((motions[name].velocity, motions[name].spin)) for name in scene.bodies]

        return jax.jvp(velocities, (variables,), (rates,))[1]

    @jax.jit
    def both(variables):
        there = coordinates.encode(free, coordinates.decode(held, variables))
        return accelerations(held, variables), accelerations(free, there)

    generator = np.random.default_rng(1)
    variables = coordinates.encode(held, unpack(start.bodies))
    shifts = jax.tree.map(lambda _: generator.normal(), variables)
    for scale in (2e-4, 1.0):
        moved = jax.tree.map(lambda value, shift, s=scale: value + s * shift, variables, shifts)
        here, there = (np.concatenate(jax.tree.leaves(found)) for found in both(moved))
        np.testing.assert_allclose(here, there, rtol=1e-6, atol=1e-6)


def test_study_runs(capsys, tmp_path):
    main(["--quick", "--output", str(tmp_path)])
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 4
    assert (tmp_path / "features.png").stat().st_size > 3000


def test_operations_are_counted_in_a_jaxpr_and_inside_it():
    def polynomial(x, y):
        return jnp.where(x > y, jnp.sin(x) * y + 1.0, jax.jit(jnp.sqrt)(x) - y)

    assert jaxpr_operations(jax.make_jaxpr(polynomial)(1.0, 2.0).jaxpr) == 5
