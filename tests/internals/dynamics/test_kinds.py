"""Elements of a kind share one function, which gives the results of elements that are written out.

The reference is the same program with each element written out, which the package makes for scenes
with few elements.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._compilation import xla
from clearjoint._dynamics.kinds import Kinds
from clearjoint._math.vectors import fold_constants
from clearjoint._native import Native
from clearjoint._native.functions import NativeFunction
from clearjoint._simulation.run import host_run, impact_recorder
from clearjoint.extend import pack, unpack
from studies.benchmark.backlash_chain import SPAN, chain
from tests.support.elements import elements
from tests.support.slow import slow, slow_but
from tests.support.symmetry_transformations import renamed

SAMPLE = ["backlash", "bushing"]
NEVER = 10**9


def several(name: str, seed: int) -> tuple[cj.Scene, cj.State]:
    """Three copies of the case of an element, at other places, with random names and order."""
    generator = np.random.default_rng(seed)
    case = elements()[name]
    bodies, joints, forces, states = {}, {}, {}, {}
    for copy in generator.permutation(3):
        word = "".join(generator.choice(list("abxyz"), 4))
        names = {old: f"{word}{copy} {k}" for k, old in enumerate(case.scene.bodies)}
        scene = renamed(case.scene, names)
        bodies |= scene.bodies
        joints |= {f"{word} {copy} {key}": joint for key, joint in scene.joints.items()}
        forces |= {f"{copy} {word} {key}": force for key, force in scene.forces.items()}
        for old, new in names.items():
            body = case.state.bodies[old]
            velocity, spin = generator.uniform(-0.5, 0.5, (2, 3))
            states[new] = cj.BodyState(body.position, body.orientation, velocity, spin)
    order = list(bodies)
    generator.shuffle(order)
    return cj.Scene({body: bodies[body] for body in order}, joints, forces), cj.State(states)


def evaluated(scene: cj.Scene, state: cj.State) -> tuple[Any, str]:
    """Rates, gaps and second rates of the gaps, and the text of the program."""

    def results(folded: Any, state: cj.State) -> Any:
        system = cj.extend.System(unpack(folded), cj.extend.Formulation(cj.AbsoluteCoordinates()))
        variables = system.encode(unpack(state).bodies)
        zero = jax.tree.map(lambda gap: 0.0, system.contact_gaps(variables), is_leaf=_is_gap)
        bristles = {
            joint: dict.fromkeys(family, cj.extend.Vector(1e-6, 2e-6, 0.0))
            for joint, family in system.scene.bristle_laws().items()
        }
        rates, powers = system.rates(variables, zero, jnp.asarray(0.1), bristles=bristles)
        found = rates, powers, system.contact_gaps(variables), system.second_rates(variables, rates)
        return jax.tree.map(lambda x: jnp.asarray(x, float), pack(found))

    function = NativeFunction(results)
    arguments = fold_constants(scene), jax.tree.map(np.asarray, state)
    found = function(*arguments)
    (program, _), *_ = function._programs.values()
    return found, program.code.text


def _is_gap(node: Any) -> bool:
    return hasattr(node, "depth")


@pytest.mark.parametrize("seed", [3, slow(11)])
@pytest.mark.parametrize("name", slow_but(["bushing"], elements()))
def test_functions_of_a_kind_give_the_results_of_written_out_elements(name, seed, monkeypatch):
    scene, state = several(name, seed)
    monkeypatch.setattr(xla, "FEWEST", 1)
    shared, text = evaluated(scene, state)
    monkeypatch.setattr(xla, "FEWEST", NEVER)
    written, _ = evaluated(scene, state)
    # Short functions are written out by native code.
    assert "define internal" in text or name not in SAMPLE
    for one, other in zip(jax.tree.leaves(shared), jax.tree.leaves(written), strict=True):
        size = np.abs(other).max() if np.size(other) else 0.0
        np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-12 * max(size, 1.0))


class Push(cj.extend.AbstractForce):
    """A user's force along an axis of the body, which a text names."""

    body: str
    axis: str
    size: float

    def body_names(self):
        return (self.body,)

    def wrenches(self, motions, t):
        units = {"x": cj.extend.UNIT_X, "y": cj.extend.UNIT_Y}
        force = motions[self.body].direction(units[self.axis] * self.size)
        return {self.body: cj.extend.Wrench(force, cj.extend.ZERO)}


class Pull(Push):
    """A force towards a body that is not among those on which it acts."""

    def wrenches(self, motions, t):
        apart = motions["y"].position - motions[self.body].position
        return {self.body: cj.extend.Wrench(apart * self.size, cj.extend.ZERO)}


class Counted(Push):
    """A force that counts how often it is evaluated."""

    calls = []

    def wrenches(self, motions, t):
        self.calls.append(self.body)
        return super().wrenches(motions, t)


def wrenches_of(kind: type[Push], axes: str) -> dict[str, np.ndarray]:
    """Forces on bodies whose names may equal those of the axes."""
    bodies = {name: cj.Body(1.0, (1.0, 1.0, 1.0)) for name in ("x", "y", "z", "w")}
    forces = {
        f"push {name}": kind(name, axis, float(k + 1))
        for k, (name, axis) in enumerate(zip(bodies, axes, strict=True))
    }
    scene = unpack(cj.Scene(bodies, forces=forces))
    places = np.random.default_rng(2).normal(size=(4, 3))
    state = cj.State(
        {name: cj.body_state(place) for name, place in zip(bodies, places, strict=True)}
    )

    def of_scene(scene: cj.Scene, state: cj.State) -> Any:
        system = cj.extend.System(scene, cj.extend.Formulation(cj.AbsoluteCoordinates()))
        variables = system.encode(unpack(state).bodies)
        motions, kinds = system.motions(variables), Kinds(scene)
        found = {}
        for element in scene.forces.values():
            found |= dict(kinds.evaluate(_wrenches, element, motions))
        return jax.tree.map(jnp.asarray, pack({name: w.force for name, w in found.items()}))

    return NativeFunction(of_scene)(scene, jax.tree.map(np.asarray, state))


def _wrenches(element: Push, motions: Any) -> list[tuple[str, cj.extend.Wrench]]:
    return list(element.wrenches(motions, 0.0).items())


@pytest.mark.parametrize("kind", [Push, Pull])
@pytest.mark.parametrize("axes", ["xyxy", "yyxx", "xxxx"])
def test_a_text_that_equals_the_name_of_a_body_keeps_its_meaning(kind, axes, monkeypatch):
    found = {}
    for fewest in (1, NEVER):
        monkeypatch.setattr(xla, "FEWEST", fewest)
        found[fewest] = wrenches_of(kind, axes)
    for name, force in found[NEVER].items():
        np.testing.assert_array_equal(found[1][name], force)


def test_elements_of_a_kind_are_traced_once():
    Counted.calls.clear()
    wrenches_of(Counted, "xyyy")
    # Once for each axis, with neutral names.
    assert len(Counted.calls) == 2 and not set(Counted.calls) & set("xyzw")


def test_the_programs_of_a_call_share_functions():
    """A later call traces them anew, since globals that they read may have changed."""
    Counted.calls.clear()
    with xla.one_call():
        first = wrenches_of(Counted, "xxxx")
        with xla.one_call():
            again = wrenches_of(Counted, "xxxx")
    assert len(Counted.calls) == 1
    for name, force in first.items():
        np.testing.assert_array_equal(again[name], force)
    wrenches_of(Counted, "xxxx")
    assert len(Counted.calls) == 2


def test_few_elements_are_written_out(monkeypatch):
    monkeypatch.setattr(xla, "FEWEST", 5)
    Counted.calls.clear()
    wrenches_of(Counted, "xyyy")
    assert sorted(Counted.calls) == sorted("xyzw")


def test_an_error_of_an_element_names_its_body():
    with pytest.raises(KeyError, match="z"):
        wrenches_of(Push, "xyzx")


def impacts_of(joints: int) -> cj.results.Solution:
    """Impacts of a chain with backlash, over a time in which rotors strike their links."""
    return cj.simulate(*chain(joints), 0.5 * SPAN, save=cj.Saving(impacts=True), progress=False)


@pytest.mark.slow
def test_impacts_by_a_function_are_those_of_contacts_that_are_written_out(monkeypatch):
    """Written out for each contact, the recorder of impacts was two thirds of the program."""
    calls, original = [], impact_recorder.peak_in_step
    monkeypatch.setattr(impact_recorder, "peak_in_step", lambda *a: calls.append(a) or original(*a))
    found = []
    for fewest, traced in ((1, 1), (NEVER, 6)):
        calls.clear()
        monkeypatch.setattr(xla, "FEWEST", fewest)
        monkeypatch.setattr(host_run, "segment_compiled", Native(host_run.segment))
        found.append(impacts_of(3).impacts)
        assert len(calls) == traced
    for field in ("onset", "separation", "entry_speed", "peak_force", "largest_penetration"):
        one, other = (getattr(impacts, field) for impacts in found)
        assert len(one) > 5
        np.testing.assert_allclose(one, other, rtol=1e-6, err_msg=field)
