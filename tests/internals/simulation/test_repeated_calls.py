"""Work of Python before a run: none of it grows faster than the mechanism or is traced again."""

import jax
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._compilation.xla import HostFirst
from clearjoint._dynamics.joint_coordinates import trees
from clearjoint._fields.objects import with_arrays
from clearjoint._native import NativeFunction
from clearjoint._native.functions import FlatArguments, folded
from clearjoint._simulation.run.run_checks import check_structure
from clearjoint.extend import unpack
from studies.benchmark.backlash_chain import chain
from tests.support.one_body import ORIGIN, Z, hinge, one_body
from tests.support.profiling import assert_linear, calls, frames

JOINT = cj.JointCoordinates()
FAST, MANY = 12, 200
SIZES = [pytest.param(FAST), pytest.param(MANY, marks=pytest.mark.slow)]


def four_bars(count: int) -> tuple[cj.Scene, cj.State]:
    """Return square four-bars that stand in a row; each closes a loop."""
    bodies, joints, states = {}, {}, {}
    for k in range(count):
        crank, coupler, rocker = names = [f"{name} {k}" for name in ("crank", "coupler", "rocker")]
        places = (2 * k, 0.5, 0), (2 * k + 0.5, 1, 0), (2 * k + 1, 0.5, 0)
        for name, place in zip(names, places, strict=True):
            bodies[name] = cj.Body(1.0, (0.01, 0.01, 0.01))
            states[name] = cj.body_state(place)
        low, high, left, right = (0, -0.5, 0), (0, 0.5, 0), (-0.5, 0, 0), (0.5, 0, 0)
        for label, *pair in (
            ("a", "ground", crank, (2 * k, 0, 0), low),
            ("b", crank, coupler, high, left),
            ("c", coupler, rocker, right, high),
            ("d", "ground", rocker, (2 * k + 1, 0, 0), low),
        ):
            joints[f"{label} {k}"] = hinge(*pair)
    return cj.Scene(bodies, joints), cj.State(states)


@pytest.mark.parametrize("mechanism", [chain, four_bars])
def test_checks_of_a_start_grow_linearly(mechanism):
    counts = []
    for size in (2, 4, 8):
        scene, state = with_arrays(mechanism(size))

        def check(scene=scene, state=state):
            check_structure(scene, state, 0.0, JOINT)

        check()  # the first one traces
        counts.append(calls(check))
    assert_linear(counts)


def test_repeated_calls_trace_nothing(monkeypatch):
    joint = {"hinge": hinge("ground", "rod", point_second=(-0.5, 0, 0))}
    scene, state = one_body("rod", joint, inertia=(0.1,) * 3, position=(0.5, 0, 0))
    traces = []

    def counted(name):
        function = getattr(jax, name)
        return lambda *args, **options: traces.append(name) or function(*args, **options)

    for name in ("eval_shape", "make_jaxpr"):
        monkeypatch.setattr(jax, name, counted(name))
    for k in range(3):
        before = len(traces)
        heavier = cj.set_value(scene, lambda s: s.bodies["rod"].mass, 1.5 + k)
        cj.simulate(heavier, state, 1e-5, progress=False)
        assert (len(traces) == before) == (k > 0), traces[before:]


@pytest.mark.slow
def test_a_repeated_call_grows_linearly_and_little():
    """Some calls for each object of the scene; arrays are read and written together."""
    counts = []
    for joints in (1, 2, 4):
        scene, state = chain(joints)

        def call(scene=scene, state=state):
            cj.simulate(scene, state, 1e-4, progress=False)

        for _ in range(10):  # native code checks the last of these starts
            call()
        counts.append(frames(call))
    assert_linear(counts)
    assert counts[1] - counts[0] < 60, counts


def test_flattening_and_folding_call_python_for_no_array():
    """JAX flattens the objects of the package by a function in Python for each; a joint has five
    objects here, and some ten arrays."""
    counts = []
    for joints in (10, 20):
        scene, state = chain(joints)

        def prepare(scene=scene, state=state):
            flat = FlatArguments.of((scene, state))
            return FlatArguments.of((folded(flat.parts[0]), state)).floats

        prepare()  # the first one finds what depends on structure
        counts.append(frames(prepare))
    objects = 7 + 2  # of a joint with its bodies; the states of the bodies are flattened twice
    assert counts[1] - counts[0] <= 10 * (objects + 3), counts


def test_results_are_read_in_groups():
    def parts(x):
        return (
            [x[k] * 2.0 for k in range(100)],
            [x[k : k + 3] for k in range(0, 90, 3)],
            x.sum() > 1,
        )

    function, x = NativeFunction(parts), np.arange(100.0)
    scalars, vectors, flag = function(x)
    assert [(one.shape, float(one)) for one in scalars] == [((), 2.0 * k) for k in range(100)]
    np.testing.assert_array_equal(np.concatenate(vectors), x[:90])
    assert flag.dtype == bool and flag
    scalars[0][...] = 7.0  # arrays share no memory
    vectors[0][0] = 8.0
    assert scalars[1] == 2.0 and vectors[1][0] == 3.0 and function(x)[0][0] == 0.0
    assert frames(lambda: function(x)) < 150  # three for each array when read one by one


def random_scene(random: np.random.Generator) -> cj.Scene:
    """Return a scene of random names, joints, loops and orders; some joints carry no body."""
    count = int(random.integers(1, 8))
    letters = random.permutation(list("abcdefghijklmnopqrstuvwxyz"))
    names = ["ground", *letters[:count].tolist()]
    kinds = [
        hinge,
        lambda *pair: cj.SphericalJoint(*pair, ORIGIN, ORIGIN),
        lambda *pair: cj.DistanceJoint(*pair, ORIGIN, (1.0, 0, 0), length=1.0),
        lambda *pair: cj.InlineJoint(*pair, ORIGIN, ORIGIN, Z),
    ]
    joints = {}
    for label in letters[count : count + int(random.integers(0, 2 * count + 1))].tolist():
        first, second = random.choice(names, 2, replace=False).tolist()
        joints[label] = kinds[random.integers(len(kinds))](first, second)
    bodies = {name: cj.Body(1.0, (1.0, 1.0, 1.0)) for name in names[1:]}
    return cj.Scene(bodies, joints)


def searched(scene: cj.Scene) -> list[list[tuple[str, str, str]]]:
    """The trees by their definition: each body is compared with each joint, breadth first."""
    placed = {"ground"}

    def children(parent):
        carried = []
        for name, joint in scene.joints.items():
            pair = joint.body_names()
            if parent in pair and isinstance(joint, cj.RevoluteJoint | cj.SphericalJoint):
                (body,) = set(pair) - {parent}
                if body not in placed:
                    placed.add(body)
                    carried.append((body, parent, name))
        return carried

    found = [[root] for root in children("ground")]
    queue = list(found)
    for name in [None, *scene.bodies]:
        if name is not None and name not in placed:
            placed.add(name)
            found.append([(name, "ground", "")])
            queue = [found[-1]]
        for tree in queue:
            for branch in tree:
                tree += children(branch[0])
        queue = []
    return found


@pytest.mark.filterwarnings("ignore::clearjoint.LooseBodyWarning")
@pytest.mark.parametrize("count", SIZES)
def test_trees_of_random_scenes_are_those_of_an_exhaustive_search(count):
    for seed in range(count):
        scene = unpack(random_scene(np.random.default_rng(seed)))
        found = [
            [(branch.body, branch.parent, getattr(branch, "joint", "")) for branch in tree]
            for tree in trees.forest(scene)
        ]
        assert found == searched(scene), seed


@pytest.mark.parametrize("count", SIZES)
def test_scenes_of_equal_structure_are_checked_by_their_own_numbers(count):
    """Other numbers, orders of bodies and joints, and names, after a first start that passes."""
    scene, state = four_bars(1)
    assert len(check_structure(*with_arrays((scene, state)), 0.0, JOINT)) == 3
    random = np.random.default_rng(7)
    for _ in range(count):
        names = dict(zip(scene.joints, random.permutation(list("pqrstuvw"))[:4], strict=True))
        order = random.permutation(list(scene.joints)).tolist()
        joints = {str(names[name]): scene.joints[name] for name in order}
        bodies = {name: scene.bodies[name] for name in random.permutation(list(scene.bodies))}
        other = cj.Scene(bodies, joints)
        assert len(check_structure(*with_arrays((other, state)), 0.0, JOINT)) == 3
        broken = str(names["b 0"])
        shift = 1e-3 * random.uniform(0.1, 1.0)
        apart = cj.set_value(other, lambda s, b=broken: s.joints[b].point_first, (0, 0.5, shift))
        with pytest.raises(ValueError, match="consistent in its positions"):
            check_structure(*with_arrays((apart, state)), 0.0, JOINT)


def test_numpy_serves_a_function_that_needs_jax_for_some_numbers_only():
    function = HostFirst(lambda x: jax.numpy.sin(x) if x > 1.0 else np.sin(x))
    for x in (0.5, 0.7, 1.5, 0.6):
        assert function(np.asarray(x)) == pytest.approx(np.sin(x), rel=1e-15)
