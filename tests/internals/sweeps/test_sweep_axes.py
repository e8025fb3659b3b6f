"""Axes of a sweep: numbers of the scene, components, initial states, and whole scenes; constraints
of all lanes, and the warning of lanes without a result."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax
import numpy as np
import pytest
import xarray as xr

import clearjoint as cj
from clearjoint._sweeps.axes import lanes_of
from clearjoint._sweeps.sweep import _warn_of_failures, checked_starts
from clearjoint.extend import result_numbers
from tests.support.dropped_rod import dropped_rod
from tests.sweeps.test_sweep_failures import ABSOLUTE, distances, held_at_two_points


def test_a_change_that_makes_the_scene_anew_varies_only_what_differs():
    """The others stay known while tracing, which makes the equations shorter."""

    def faster(scene, state, speed):
        return cj.mechanisms.slider_crank(scene.joints["slider pin"].clearance, speed=speed)

    axis = cj.Axis.change(faster, [100.0, 200.0], "rad/s")
    scene, state = cj.mechanisms.slider_crank(speed=300.0)
    lanes = lanes_of(scene, state, {"speed": axis}, {"speed": axis.values})
    assert lanes.varied.joints["motor"].speed
    assert sum(jax.tree.leaves(lanes.varied)) == 1
    np.testing.assert_array_equal(lanes.scenes.joints["motor"].speed, [100.0, 200.0])


def lanes(axes):
    values = {name: axis.values for name, axis in axes.items()}
    return lanes_of(*cj.mechanisms.double_pendulum(), axes, values)


def test_tied_numbers_components_and_initial_states_reach_the_lanes():
    found = lanes(
        {
            "masses": cj.Axis(lambda s: [body.mass for body in s.bodies.values()], [1.0, 2.0]),
            "gravity": cj.Axis(lambda s: s.gravity[1], [9.0, 10.0]),
            "height": cj.Axis.initial(lambda s: s.bodies["arm 2"].position[1], [0.1, 0.2]),
        }
    )
    scene, state = found.of(1)
    assert [float(body.mass) for body in scene.bodies.values()] == [2.0, 2.0]
    np.testing.assert_array_equal(scene.gravity, [0.0, 10.0, 0.0])
    np.testing.assert_array_equal(state.bodies["arm 2"].position, [0.5, 0.2, 0.0])
    np.testing.assert_array_equal(state.bodies["arm 3"].position, [1.0, 0.0, 0.5])
    varied = [value for value in jax.tree.leaves(found.varied) if value]
    assert len(varied) == 3 and not found.bad


class Tabled(cj.laws.Hertz):
    """Hertz's law with a table of three depths, m, which are no vector."""

    depths: Any = eqx.field(
        converter=np.asarray, default=(0.0, 1e-6, 2e-6), metadata={"table": True}
    )


def test_tables_in_the_joints_of_all_lanes_stay_tables():
    scene, state = dropped_rod()
    scene = replace(scene, joints={"pin": replace(scene.joints["pin"], law=Tabled(1e9))})
    values = np.array([1e-4, 2e-4])
    axes = {"clearance": cj.Axis(lambda s: s.joints["pin"].clearance, values)}
    joint = lanes_of(scene, state, axes, {"clearance": values}).contact_joints()["pin"]
    np.testing.assert_array_equal(joint.clearance, values)
    np.testing.assert_array_equal(joint.law.depths, [Tabled(1e9).depths] * 2)


@pytest.mark.parametrize("lowest, redundant", [(0.0, True), (0.1, False)])
def test_constraints_of_all_lanes_decide_whether_they_depend_on_each_other(lowest, redundant):
    """Not those of the first alone, and not those of a lane that nothing runs."""
    values = np.array([0.2, 1e-6, lowest, 0.3])
    lanes = lanes_of(*held_at_two_points(0.2), {"d": distances(values)}, {"d": values})
    lanes, found = checked_starts(lanes, 0.0, ABSOLUTE)
    assert found == redundant and set(lanes.bad) == {1}


def test_pending_lanes_have_not_failed():
    """Another process may discard lanes that this one has computed."""
    none_bad = SimpleNamespace(bad={})
    limit = result_numbers()["max_steps_reached"]
    for codes, text in (
        ([-1, 0, -1], "^2 of 3 lanes are pending: .*same arguments"),
        ([-1, limit, 0], "^1 of 3 lanes failed: 1 max_steps_reached.*1 of 3 lanes are pending"),
    ):
        with pytest.warns(UserWarning, match=text) as caught:
            _warn_of_failures(xr.Dataset({"result": ("lane", codes)}), none_bad, 0.0, None)
        assert caught[0].filename == __file__
