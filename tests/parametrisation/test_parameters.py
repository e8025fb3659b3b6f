"""Paths of numbers: listing, replacing and tying numbers, and paths that lead to no number."""

import re
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import logit

import clearjoint as cj


@pytest.fixture(scope="module")
def scene():
    return cj.mechanisms.double_pendulum()[0]


def test_listed_parameters_can_be_found_by_the_names_they_have(scene):
    listed = cj.parameters(scene)
    assert len(listed) == len(jax.tree.leaves(scene))
    assert listed["joints['shoulder'].clearance"] == (5e-4, "m")
    assert listed["joints['shoulder'].law.stiffness.young_modulus"] == (207e9, "Pa")
    assert listed["gravity"][1] == "m/s^2"
    for name, (value, _) in listed.items():
        assert eval(f"scene.{name}", {"scene": scene}) is value


def test_set_value_replaces_one_number_and_shares_the_rest(scene):
    changed = cj.set_value(scene, lambda s: s.joints["shoulder"].clearance, 1e-4)
    value = changed.joints["shoulder"].clearance
    assert isinstance(value, np.ndarray) and value.dtype == np.float64 and value == 1e-4
    assert changed.bodies["arm 2"].inertia is scene.bodies["arm 2"].inertia
    assert scene.joints["shoulder"].clearance == 5e-4


def test_set_value_replaces_components_and_ties(scene):
    changed = cj.set_value(scene, lambda s: s.gravity[1], 1.5)
    np.testing.assert_array_equal(changed.gravity, [0.0, 1.5, 0.0])
    np.testing.assert_array_equal(scene.gravity, [0.0, 9.81, 0.0])
    tied = cj.set_value(
        scene, lambda s: (s.bodies["arm 2"].mass, s.bodies["arm 3"].inertia[0]), 3.0
    )
    assert tied.bodies["arm 2"].mass == tied.bodies["arm 3"].inertia[0] == 3.0
    whole = cj.set_value(scene, lambda s: s.joints["elbow"].axis_first, (0.0, 1.0, 0.0))
    np.testing.assert_array_equal(whole.joints["elbow"].axis_first, [0.0, 1.0, 0.0])


def test_put_works_while_jax_traces(scene):
    def pull(x):
        return cj.set_value(scene, lambda s: s.gravity[1], x).gravity

    np.testing.assert_array_equal(jax.jit(pull)(2.0), [0.0, 2.0, 0.0])
    np.testing.assert_array_equal(jax.jacfwd(pull)(2.0), [0.0, 1.0, 0.0])


@pytest.mark.parametrize(
    ("path", "message"),
    [
        (lambda s: s.joints["knee"].clearance, "knee"),
        (lambda s: s.joints["shoulder"].gap, "gap"),
        (lambda s: s.gravity[1] * 2.0, "unsupported operand"),
        (lambda s: s.joints["shoulder"].friction, "NoneType"),
        (lambda s: s.joints["shoulder"].law.stiffness, "RavnStiffness"),
        (lambda s: s, "Scene"),
        (lambda s: [], "is \\[\\]"),
        (lambda s: [*s.gravity], "not iterable"),
        (lambda s: 9.81, "float"),
    ],
)
def test_paths_that_lead_to_no_number_are_refused(scene, path, message):
    with pytest.raises(
        ValueError, match=rf"`path` must be a function.*{message}.*parameters\((tree|scene)\)"
    ):
        cj.set_value(scene, path, 1.0)


def test_values_and_components_that_do_not_fit_are_refused(scene):
    with pytest.raises(ValueError, match=r"`value`.*shape \(3,\).*is 1\.0"):
        cj.set_value(scene, lambda s: s.gravity, 1.0)
    with pytest.raises(ValueError, match=r"`path`.*\[3\].*shape \(3,\)"):
        cj.set_value(scene, lambda s: s.gravity[3], 1.0)
    # JAX would read the last component, and set none.
    for gravity in (scene.gravity, jnp.asarray(scene.gravity)):
        same = cj.set_value(scene, lambda s: s.gravity, gravity)
        with pytest.raises(ValueError, match=r"`path`.*\[3\].*shape \(3,\)"):
            cj.Parameter(lambda s: s.gravity[3]).coordinate_in(same, None)
        with pytest.raises(ValueError, match=r"`path`.*\[3\].*shape \(3,\)"):
            cj.set_value(same, lambda s: s.gravity[3], 1.0)


def test_a_parameter_without_a_value_is_refused(scene):
    made = cj.Parameter(cj.Parameter.change(lambda scene, state, x: (scene, state), 1.0).variation)
    with pytest.raises(ValueError, match=r"`value` must be.*MadeByFunction.*is None: pass"):
        made.coordinate_in(scene, None)


def test_the_limit_of_information_between_bounds():
    """It stands for one standard deviation of the value, in the middle for a uniform value."""
    scale = cj.Bounded(-1.0, 1.0)
    uniform = np.random.default_rng(0).uniform(0.0, 1.0, 100_000)
    assert scale.uninformative_std(0.0) == pytest.approx(np.std(logit(uniform)), rel=0.01)
    errors = [scale.uninformative_std(u) * scale.slope(u) for u in (-7.0, 0.0, 3.0)]
    np.testing.assert_allclose(errors, errors[1], rtol=1e-12)


def test_a_function_may_return_integers():
    """A free body whose velocity is an array of integers, in a sweep and with derivatives."""
    scene = cj.Scene({"b": cj.Body(1.0, (1.0, 1.0, 1.0))})
    start = cj.State({"b": cj.body_state((0.0, 0.0, 0.0))})

    def thrown(scene, state, x):
        body = replace(state.bodies["b"], velocity=np.array([1, 2, 3]))
        place = cj.set_value(cj.State({"b": body}), lambda s: s.bodies["b"].position[0], x)
        return scene, place

    axes, z = {"x": cj.Axis.change(thrown, [0.5, 2.0])}, cj.quantities.Position("b", "z")
    swept = cj.sweep(scene, start, 0.5, axes, progress=False)
    expected = [[1.0, 1.0, 1.5], [2.5, 1.0, 1.5]]
    np.testing.assert_allclose(swept["final_position"].sel(body="b"), expected)
    x = {"x": cj.Parameter.change(thrown, 0.5)}
    found = cj.sensitivities(scene, start, 0.5, x, {"z": z}, [0.5], progress=False)
    np.testing.assert_allclose(found.derivatives["z"], 0.0, atol=1e-12)


def clearance(scene):
    return scene.joints["shoulder"].clearance


X = {"x": cj.quantities.Position("arm 2", "x")}
BODY = "arm 2"
PAIRS = {
    "a number": (clearance, lambda scene: scene.joints["shoulder"].clearance),
    "a vector and its component": (
        lambda scene: scene.bodies[BODY].inertia,
        lambda scene: scene.bodies[BODY].inertia[1],
    ),
    "an element and its number": (
        lambda scene: scene.bodies[BODY],
        lambda scene: scene.bodies[BODY].mass,
    ),
    "tied numbers": (
        lambda scene: [body.mass for body in scene.bodies.values()],
        lambda scene: scene.bodies[BODY].mass,
    ),
}
SAME = "must be each of another number, but is {}"


@pytest.mark.parametrize("pair", PAIRS)
def test_two_paths_to_the_same_number_are_refused(pair):
    """The earlier one would have no effect."""
    scene, state = cj.mechanisms.double_pendulum()
    for first, second in (PAIRS[pair], PAIRS[pair][::-1]):
        paths = {"a": first, "other": lambda scene: scene.gravity[0], "b": second}
        with pytest.raises(ValueError, match=re.escape(SAME.format(["a", "b"]))):
            cj.predictor(scene, state, 0.01, paths, X, [0.01])


def test_two_parameters_or_axes_of_the_same_number_are_refused():
    scene, state = cj.mechanisms.double_pendulum()
    parameters = {"a": cj.Parameter(clearance), "b": cj.Parameter(clearance, cj.Log())}
    axes = {name: cj.Axis(clearance, [1e-4]) for name in "ab"}
    measured = cj.Measurements({"x": cj.Series(X["x"], [0.01], [0.0], noise=1e-3)})
    refused = pytest.raises(ValueError, match=re.escape(SAME.format(["a", "b"])))
    with refused:
        cj.sensitivities(scene, state, 0.01, parameters, X, [0.01])
    with refused:
        cj.identify(scene, state, measured, parameters)
    with refused:
        cj.sweep(scene, state, 0.01, axes=axes)


def test_components_of_a_vector_are_different_numbers():
    scene, state = cj.mechanisms.double_pendulum()
    axes = {n: cj.Axis(lambda s, k=k: s.gravity[k], [1.0]) for k, n in enumerate("xyz")}
    axes["vx"] = cj.Axis.initial(lambda state: state.bodies[BODY].velocity[0], [0.0])
    axes["length"] = cj.Axis.change(lambda scene, state, value: (scene, state), [1.0])
    swept = cj.sweep(scene, state, 1e-4, axes=axes, progress=False)
    assert bool((swept["result"] == 0).all())
