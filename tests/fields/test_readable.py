"""Elements print their numbers as they were given."""

import importlib
import inspect
import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint import RESULTS
from tests.support.one_body import one_body
from tests.support.public_names import MODULES
from tests.support.rooms import DOORS


def test_a_scene_shows_its_numbers():
    scene, state = cj.mechanisms.double_pendulum()
    text = repr(scene)
    for part in ("mass=7.02", "inertia=[0.001, 0.5855, 0.5855]", "clearance=0.0005", "gravity="):
        assert part in text
    assert "numpy" not in text and "f64" not in text
    assert "position=[0.5, 0.0, 0.0]" in repr(state)


@pytest.mark.parametrize(
    ("element", "text"),
    [
        (cj.Body(1.5, (1, 2, 3)), "Body(mass=1.5, inertia=[1.0, 2.0, 3.0])"),
        (cj.laws.Hertz(1e8), "Hertz(stiffness=GivenStiffness(stiffness=100000000.0))"),
        (cj.frictions.RegularisedCoulomb(0.1), "RegularisedCoulomb(coefficient=0.1"),
        (cj.Baumgarte(3.0, 4.0), "Baumgarte(alpha=3.0, beta=4.0)"),
        (cj.SphericalJoint("a", "b", (0, 1, 2), (3, 4, 5)), "point_first=[0.0, 1.0, 2.0]"),
        (cj.Body(jnp.asarray(2.0), np.eye(3)), "mass=2.0"),
    ],
)
def test_elements_show_their_numbers(element, text):
    assert text in repr(element).replace("\n  ", " ")


def test_long_arrays_and_traced_numbers_print_dtype_and_shape():
    long = cj.results.Trajectory(np.zeros(1000), cj.State({"arm": cj.body_state((0, 0, 0))}))
    assert "times=f64[1000](numpy)" in repr(long)
    seen = []
    jax.jit(lambda mass: seen.append(repr(cj.Body(mass, (1, 1, 1)))))(1.0)
    assert seen[0].startswith("Body(mass=") and "inertia=[1.0, 1.0, 1.0]" in seen[0]


def test_every_result_prints_text():
    for code in RESULTS._name_to_item.values():
        assert RESULTS[code] != ""
        assert RESULTS[code] in str(code)
    assert "reached its end" in str(RESULTS.successful)


def test_a_solution_prints_in_a_few_lines():
    scene, state = one_body("ball", position=(0.1, 0, 0))
    save = cj.Saving(np.linspace(0.0, 0.3e-2, 4), impacts=True)
    solution = cj.simulate(scene, state, 0.3e-2, save=save, progress=False)
    lines = str(solution).splitlines()
    assert lines[0] == "Solution at t = 0.003 s: The run reached its end time."
    assert "saved: 4 states of 'ball' from 0.0 s to 0.003 s" in lines[2]
    assert lines[3:] == ["  impacts: 0", "  'ball' at (0.1, 0, 0) m with (0, 0, 0) m/s"]
    assert repr(solution) == str(solution)


@pytest.mark.parametrize("module", MODULES)
def test_public_modules_list_neither_modules_nor_types_of_numpy(module):
    namespace = importlib.import_module(module)
    listed = {name: getattr(namespace, name) for name in dir(namespace)}
    modules = {name for name, value in listed.items() if isinstance(value, types.ModuleType)}
    assert modules <= {*DOORS, "densities", "plot", "quantities", "testing", "style"}
    callables = [value for value in listed.values() if inspect.isroutine(value)]
    assert not [one for one in callables if "numpy._typing" in str(inspect.signature(one))]


def test_a_list_may_contain_a_traced_number():
    def torque(switch):
        return cj.PiecewiseConstant([0.0, switch], [1.0, 2.0 * switch])(0.3)

    value, slope = jax.jvp(torque, (0.2,), (1.0,))
    assert (float(value), float(slope)) == pytest.approx((0.4, 2.0))
    with pytest.raises(ValueError, match="`times` must be a row of two or more times"):
        jax.jit(lambda x: cj.PiecewiseConstant([[0.0, x]] * 2, [1.0, 2.0]).times)(1.0)
