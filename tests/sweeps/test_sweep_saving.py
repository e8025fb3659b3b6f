"""Outputs and a `Saving` keep the same results of lanes as of single runs."""

import diffrax
import jax
import numpy as np
import pytest

import clearjoint as cj
from clearjoint.quantities import AbstractQuantity
from tests.support.rotor import AFTER, OUTPUTS, TIMES, angle, rotor, swept

STIFFNESS = [10.0, 40.0]
STEADY = cj.Saving(TIMES)
ZERO = {"zero": OUTPUTS["zero"], "angle": angle}
PARTS = ("position", "orientation", "velocity", "spin")


@pytest.fixture(scope="module")
def lanes(tmp_path_factory):
    path = tmp_path_factory.mktemp("store") / "sweep"
    swept(STIFFNESS, save=STEADY, outputs=ZERO, path=path, zipped=False)
    return cj.open_sweep(path)


@pytest.mark.parametrize("lane", range(2))
def test_states_and_outputs_of_a_lane_are_those_of_its_single_run(lanes, lane):
    run = cj.simulate(*rotor(STIFFNESS[lane]), 1.0, save=STEADY, outputs=ZERO)
    there, here = run.states.bodies["rotor"], lanes.isel(stiffness=lane).sel(body="rotor")
    np.testing.assert_array_equal(here.saved_time, TIMES)
    for part in PARTS:
        found, expected = here[f"saved_{part}"].values, getattr(there, part)
        assert found.shape == expected.shape
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(here["angle"], run.outputs["angle"], rtol=1e-12, atol=1e-12)
    crossings = run.outputs["zero"]
    kept = slice(int(here.zero_count))
    assert len(crossings) == kept.stop >= 1 and (crossings.times > AFTER).all()
    np.testing.assert_allclose(here.zero_time[kept], crossings.times, rtol=1e-12)
    np.testing.assert_allclose(here.zero_spin[kept], crossings.values["spin"], rtol=1e-12)


class Lost(AbstractQuantity):
    """Of a body that no scene has."""

    def __call__(self, now):
        return now.motions["lost"].position.x

    def check(self, scene):
        raise ValueError("no body 'lost'")


LOST = {"zero": cj.Section(Lost(), OUTPUTS["zero"].channels, 2)}


def test_a_run_that_cannot_look_inside_steps_refuses_sections():
    with pytest.raises(ValueError, match="sections.*Tsit5"):
        cj.simulate(*rotor(), 1.0, cj.Settings(solver=diffrax.Kvaerno5()), STEADY, outputs=ZERO)
    with pytest.raises(ValueError, match="Output 'zero'.*'lost'"):
        cj.simulate(*rotor(), 1.0, outputs=LOST)
    with pytest.raises(ValueError, match=r"`outputs\['zero'\]`.*under a transformation"):
        jax.jit(lambda end: cj.simulate(*rotor(), end, outputs=LOST).time)(1.0)


def test_names_may_be_strings_of_numpy(tmp_path):
    """A store with such a name is extended by another output: x = t."""
    scene = cj.Scene({"b": cj.Body(1.0, (1.0, 1.0, 1.0))})
    start = cj.State({"b": cj.body_state((0.0, 0.0, 0.0), velocity=(1.0, 0.0, 0.0))})
    axes = {"mass": cj.Axis(lambda scene: scene.bodies["b"].mass, [1.0, 2.0])}
    place = cj.Peak(cj.quantities.Position("b", "x"), "m")
    options = {"path": tmp_path / "runs.zarr", "progress": False}
    cj.sweep(scene, start, 0.5, axes, {np.array(["place"])[0]: place}, **options)
    outputs = {"place": place, "speed": cj.Peak(cj.quantities.Velocity("b"), "m/s")}
    extended = cj.sweep(scene, start, 0.5, axes, outputs, **options)
    np.testing.assert_allclose(extended["place"], 0.5)
    np.testing.assert_allclose(extended["speed"], 1.0)
