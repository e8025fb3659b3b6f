"""The general equations of motion compared with those of a slider-crank by hand."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._math.vectors import fold_constants
from clearjoint.extend import Formulation, Gap, System, contact_normal_force, unpack

FORMULATION = Formulation()
CRANK, ROD = cj.mechanisms.CRANK_LENGTH, cj.mechanisms.ROD_LENGTH


def without_motor(scene):
    joints = {name: joint for name, joint in scene.joints.items() if name != "motor"}
    return cj.Scene(scene.bodies, joints, scene.forces, scene.gravity)


def slider_crank_accelerations(system, variables, entry_speeds, t):
    """Angular accelerations of crank and rod (relative), rad/s^2, and the slider's, m/s^2.

    Both bases of the pin carry the force of base V.
    """
    scene = system.scene
    crank, rod, slider = (variables[name] for name in ("crank", "rod", "slider"))
    (turn,), (bend,), (slide,) = crank.speeds, rod.speeds, slider.speeds
    swing, rod_angle = turn + bend, crank.position + rod.position
    cos_crank, sin_crank = jnp.cos(crank.position), jnp.sin(crank.position)
    cos_rod, sin_rod = jnp.cos(rod_angle), jnp.sin(rod_angle)
    # The rod's end relative to the centre of the slider, and its rate.
    x = CRANK * cos_crank + ROD * cos_rod - slider.position
    y = CRANK * sin_crank + ROD * sin_rod
    x_rate = -CRANK * sin_crank * turn - ROD * sin_rod * swing - slide
    y_rate = CRANK * cos_crank * turn + ROD * cos_rod * swing
    distance = jnp.sqrt(jnp.maximum(x * x + y * y, 1e-300))
    n_x, n_y = x / distance, y / distance
    pin = scene.joints["slider pin"]
    gap = Gap(
        distance - pin.clearance, x_rate * n_x + y_rate * n_y, pin.bearing_radius, pin.clearance
    )
    force = 2.0 * contact_normal_force(pin.law, gap, entry_speeds["slider pin"]["V"])
    # Lagrange's equations of crank and rod with a rod of mass m, centred at half its length.
    mass, centre = scene.bodies["rod"].mass, 0.5 * ROD
    coupling = mass * CRANK * centre
    cos_bend = cos_rod * cos_crank + sin_rod * sin_crank
    sin_bend = sin_rod * cos_crank - cos_rod * sin_crank
    load = force * ROD * (n_x * sin_rod - n_y * cos_rod) - coupling * sin_bend * turn * turn
    crank_load = (
        force * CRANK * (n_x * sin_crank - n_y * cos_crank) + coupling * sin_bend * swing * swing
    )
    inertia = scene.bodies["rod"].inertia.z + mass * centre * centre
    if "motor" in scene.joints:
        motor = scene.joints["motor"]
        error = crank.position - motor.angle(t)
        wrapped = error - 2.0 * math.pi * jnp.round(error / (2.0 * math.pi))
        turn_rate = system.formulation.stabilisation.target(wrapped, turn - motor.speed)
    else:
        body, mixed = scene.bodies["crank"], coupling * cos_bend
        own = body.inertia.z + body.mass * (0.5 * CRANK) ** 2 + mass * CRANK * CRANK
        turn_rate = (crank_load * inertia - mixed * load) / (own * inertia - mixed * mixed)
    swing_rate = (load - coupling * cos_bend * turn_rate) / inertia
    return turn_rate, swing_rate - turn_rate, force * n_x / scene.bodies["slider"].mass


@pytest.mark.parametrize(
    "changed", [lambda scene: scene, without_motor], ids=["driven", "coasting"]
)
def test_slider_crank_has_the_accelerations_written_by_hand(changed):
    scene, state = cj.mechanisms.slider_crank()
    scene = unpack(fold_constants(changed(scene)))
    start = FORMULATION.coordinates.encode(scene, unpack(state.bodies))
    entry_speeds = {"slider pin": {base: jnp.asarray(0.1) for base in "VW"}}

    @jax.jit
    def both(variables):
        arguments = System(scene, FORMULATION), variables, entry_speeds, jnp.asarray(0.01)
        rates = System.rates(*arguments)[0]
        general = [rates[name].speeds[0] for name in ("crank", "rod", "slider")]
        return general, slider_crank_accelerations(*arguments)

    generator, pressed = np.random.default_rng(0), 0
    for _ in range(8):
        variables = jax.tree.map(
            lambda value: value + generator.normal() * (6e-4 if abs(value) < 1.0 else 50.0), start
        )
        general, by_hand = (np.array(rates) for rates in both(variables))
        np.testing.assert_allclose(by_hand, general, rtol=1e-7, atol=1e-9)
        pressed += abs(general[-1]) > 1.0
    assert 0 < pressed < 8
