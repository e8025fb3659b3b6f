"""What a program with derivatives tells native code."""

import numpy as np
import pytest

import clearjoint as cj
from clearjoint._compilation.xla import program_of
from clearjoint._parametrisation.parametrised_scene import parametrised


@pytest.mark.parametrize("count", [1, 2, 5])
def test_the_number_of_tangents_is_told(count):
    scene, state = cj.mechanisms.double_pendulum()
    paths = (
        lambda scene: scene.joints["shoulder"].clearance,
        lambda scene: scene.joints["shoulder"].law.restitution,
        lambda scene: scene.joints["shoulder"].bearing_radius,
        lambda scene: scene.joints["shoulder"].journal_length,
        lambda scene: next(iter(scene.bodies.values())).mass,
    )
    parameters = {str(k): cj.Parameter(path) for k, path in enumerate(paths[:count])}
    family = parametrised(scene, state, parameters, np.ones(count))

    def derivatives(t):
        play = lambda scene: (scene.joints["shoulder"].clearance * t, None)  # noqa: E731
        return family.with_derivatives(play, (), ())[2]

    assert program_of(derivatives, 0.0).tangents == count
    assert program_of(lambda t: 2.0 * t, 0.0).tangents == 0
