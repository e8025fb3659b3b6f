"""Which numbers of a scene a sweep takes as varied."""

import jax
import numpy as np

import clearjoint as cj
from clearjoint.sweeps.axes import lanes_of


def test_a_change_that_makes_the_scene_anew_varies_only_what_differs():
    """The others stay known while tracing, which makes the equations shorter."""

    def faster(scene, state, speed):
        return cj.slider_crank(scene.joints["slider pin"].clearance, speed=speed)

    axis = cj.Axis.change(faster, [100.0, 200.0], "rad/s")
    scene, state = cj.slider_crank(speed=300.0)
    lanes = lanes_of(scene, state, {"speed": axis}, {"speed": axis.values})
    assert lanes.varied.joints["motor"].speed
    assert sum(jax.tree.leaves(lanes.varied)) == 1
    np.testing.assert_array_equal(lanes.scenes.joints["motor"].speed, [100.0, 200.0])
