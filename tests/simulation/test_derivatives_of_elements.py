"""Derivatives of a motion by numbers of every element, against differences of runs."""

import jax
import numpy as np
import pytest

import clearjoint as cj
from tests.support.elements import elements

END, COUNT = 0.02, 3
STEPS = (1e-4, 1e-5, 1e-6)
"""Steps of the differences, relative to the number: the best of them counts, since a step may be
too large near a kink, or so small that rounding errors remain."""
NO_NUMBERS = "teeth", "orientation", "normal", "slot_axis", "slider_axis"
"""Fields of whole numbers, of Euler parameters, which have unit norm, and of perpendicular axes."""
AT_THE_WALL = "point on a plane", "edge on a plane", "sphere on a plane", "ball on ball"
"""Contacts of which it depends on the number whether they begin at the start or were before."""
KINKED = "ButenschoenFilm"
"""From the centre, its journal moves along a kink of the film's force: the sum of spins is zero."""
FREE = [
    name
    for name, case in elements().items()
    if "element" in case.scene.forces or "element" in case.scene.contact_joints()
    if name not in ("bearing that holds its journal", "massless link", *AT_THE_WALL, KINKED)
]
"""Elements that do not constrain the initial state."""


def moving(case, generator):
    """The state of a case with velocities at random, as far as its joints allow them."""
    bodies = {
        name: cj.body_state(
            body.position,
            body.orientation,
            velocity=0.3 * generator.standard_normal(3),
            spin=2.0 * generator.standard_normal(3),
        )
        for name, body in case.state.bodies.items()
    }
    return cj.assemble(case.scene, cj.State(bodies))


def numbers_of(scene):
    """Places of all numbers of the element: the index of an array, and the index in the array."""
    leaves = jax.tree_util.tree_leaves_with_path(scene)
    named = [(jax.tree_util.keystr(path), np.asarray(leaf)) for path, leaf in leaves]
    return [
        (k, index)
        for k, (name, leaf) in enumerate(named)
        if "'element'" in name and leaf.dtype.kind == "f"
        if not any(field in name for field in NO_NUMBERS)
        for index in np.ndindex(leaf.shape)
    ]


def at(scene, place):
    leaf = jax.tree.leaves(scene)[place[0]]
    return leaf[place[1]] if place[1] else leaf


def ended(scene, state):
    settings = cj.Settings(rtol=1e-12, atol=1e-17)
    bodies = cj.simulate(scene, state, END, settings, progress=False).final.bodies.values()
    return np.concatenate([np.r_[body.position, body.velocity] for body in bodies])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::clearjoint.UnusualValueWarning")
@pytest.mark.parametrize("name", FREE)
def test_derivatives_by_numbers_of_an_element_are_those_of_differences(name):
    """Of three numbers at random, from velocities at random."""
    case, generator = elements()[name], np.random.default_rng(len(name))
    scene, state = case.scene, moving(case, generator)
    places = numbers_of(scene)
    chosen = [places[k] for k in generator.permutation(len(places))[:COUNT]]
    paths = {str(p): cj.Parameter(lambda scene, p=p: at(scene, p)) for p in chosen}
    quantities = {
        f"{body} {kind.__name__} {axis}": kind(body, axis)
        for body in scene.bodies
        for kind in (cj.quantities.Position, cj.quantities.Velocity)
        for axis in "xyz"
    }
    settings = cj.Settings(rtol=1e-9)
    found = cj.sensitivities(scene, state, END, paths, quantities, [END], settings, progress=False)
    derivatives = np.stack([found.derivatives[name][0] for name in quantities])
    for place, derivative in zip(chosen, derivatives.T, strict=True):
        value = float(at(scene, place))

        def moved(by, place=place, value=value):
            return ended(cj.set_value(scene, lambda s: at(s, place), value + by), state)

        size = max(np.abs(derivative).max(), 1e-3)
        steps = [step * (abs(value) or 1.0) for step in STEPS]
        slopes = [(moved(step) - moved(-step)) / (2.0 * step) for step in steps]
        assert min(np.abs(slope - derivative).max() for slope in slopes) < 1e-4 * size, place
