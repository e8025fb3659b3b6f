"""Every scene of the catalogue in native code: runs against XLA's, lanes and derivatives."""

import functools
import warnings
from typing import Any

import equinox as eqx
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._native import NativeFallbackWarning
from clearjoint._native.compiled import SWITCH
from tests.support.catalogue_scenes import CatalogueScene, catalogue_scenes

SCENES = catalogue_scenes()
FINE = cj.Settings(rtol=1e-12)
CLOSE = 1e-9
DERIVATIVES = cj.Settings(rtol=1e-12, landing_tolerance=1e-13)
STEP = 1e-4
"""Of the logarithm of a factor, in differences. They divide the errors of runs by 2 STEP: at rtol
1e-10 those of clamped laws, whose force has a kink within a step, make 2e-4 of a slope."""


@pytest.fixture(autouse=True)
def without_fallback():
    """XLA compiles only where a test switches to it."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", NativeFallbackWarning)
        warnings.simplefilter("ignore", cj.LawRangeWarning)
        yield


def run(scene: CatalogueScene, settings: cj.Settings) -> cj.results.Solution:
    save = cj.Saving(np.linspace(0.0, scene.end, 5), impacts=True)
    return cj.simulate(*scene.make(), scene.end, settings, save, progress=False)


def assert_close(one: Any, other: Any, name: str, relative: float = CLOSE) -> None:
    one, other = np.asarray(one), np.asarray(other)
    assert one.shape == other.shape, name
    scale = np.abs(other).max(initial=0.0)
    np.testing.assert_allclose(one, other, rtol=0.0, atol=relative * scale, err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_a_run_agrees_with_xla(name, monkeypatch):
    """States to 1e-9 of the scene's largest length and speed, before chaos makes differences of
    roundings grow."""
    native = run(SCENES[name], FINE)
    monkeypatch.setenv(SWITCH, "0")
    xla = run(SCENES[name], FINE)
    ours, theirs = native.states, xla.states
    for field in ("position", "orientation", "velocity", "spin"):
        found, expected = (
            np.stack([getattr(body, field) for body in states.bodies.values()])
            for states in (ours, theirs)
        )
        assert_close(found, expected, field)
    # By contact: the order of onsets at one instant, of two edges of a guide, is rounding's.
    ours, theirs = (
        (run.impacts, np.lexsort((run.impacts.onset, run.impacts.contact, run.impacts.joint)))
        for run in (native, xla)
    )
    for field in ("onset", "entry_speed", "peak_force", "largest_penetration"):
        found, expected = (getattr(table, field)[order] for table, order in (ours, theirs))
        assert_close(found, expected, field, 1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_lanes_and_derivatives_agree_with_single_runs(name):
    """Along a factor of the mass and inertia of one body: the middle of three lanes ends where a
    run does, and their difference is what `sensitivities` gives."""
    scene, state = SCENES[name].make()
    end, body = SCENES[name].end, SCENES[name].body or list(scene.bodies)[-1]

    def weigh(scene: cj.Scene, state: cj.State, factor: Any) -> tuple[cj.Scene, cj.State]:
        def place(scene: cj.Scene) -> Any:
            return scene.bodies[body].mass, scene.bodies[body].inertia

        return eqx.tree_at(place, scene, replace_fn=lambda number: factor * number), state

    axis = cj.Axis.change(weigh, np.exp(STEP * np.array([-1.0, 0.0, 1.0])))
    swept = cj.sweep(scene, state, end, {"factor": axis}, settings=DERIVATIVES, progress=False)
    alone = cj.simulate(scene, state, end, DERIVATIVES, progress=False).final
    for field in ("position", "orientation", "velocity", "spin"):
        lanes = swept[f"final_{field}"].sel(body=list(alone.bodies)).values
        single = np.stack([getattr(body, field) for body in alone.bodies.values()])
        assert_close(lanes[1], single, field)

    of_body = {
        "position": cj.quantities.Position,
        "velocity": cj.quantities.Velocity,
        "spin": functools.partial(cj.quantities.AngularVelocity, axes="body"),
    }
    outputs = {f"{field} {x}": of(body, x) for field, of in of_body.items() for x in "xyz"}
    parameter = {"factor": cj.Parameter.change(weigh, 1.0, cj.Log())}
    found = cj.sensitivities(
        scene, state, end, parameter, outputs, [end], DERIVATIVES, progress=False
    ).derivatives
    for field in of_body:
        slopes = np.array([found[f"{field} {x}"][0, 0] for x in "xyz"])
        ends = swept[f"final_{field}"].sel(body=body).values
        expected = (ends[2] - ends[0]) / (2.0 * STEP)
        allowed = 1e-7 * np.abs(ends[1]).max() + 1e-4 * np.abs(expected).max()
        np.testing.assert_allclose(slopes, expected, rtol=0.0, atol=allowed, err_msg=field)
