"""Penetrations in a cycloid stage."""

import warnings

import numpy as np
import pytest

import clearjoint as cj
from clearjoint._dynamics.journals import depths
from clearjoint._fields.cautions import quiet
from tests.model.test_mechanisms_with_clearance import first_contact


@pytest.mark.slow
@pytest.mark.parametrize("shaft", [0.0, 0.3, 2.0])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_the_backlash_of_a_cycloid_stage_is_that_of_its_pins(shaft, sense):
    """One pin touches at the angle at which the geometry has it touch, and the others are free."""
    play = 0.02e-3
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene, state = cj.mechanisms.cycloid_stage(play, angle=shaft)
    report = cj.constraint_report(scene, state)
    assert report.degrees_of_freedom() == 1
    assert np.abs(report.values).max() < 1e-12 and np.abs(report.rates).max() < 1e-12
    turn = first_contact(shaft, play, sense)
    # To first order by the formula of the docstring: a pin moves across its radius.
    directions = -shaft / 10 + np.pi / 2 + 2.0 * np.pi * np.arange(6) / 6
    cosine = np.abs(np.cos(directions - shaft)).max()
    assert abs(turn) == pytest.approx(play / 25e-3 / cosine, rel=0.02)
    angle = -shaft / 10 + turn
    output = cj.body_state((0.0, 0.0, 0.0), cj.rotation((0.0, 0.0, 1.0), angle))
    with quiet():
        gaps = depths(scene, cj.State({**state.bodies, "output": output}))
    deepest = sorted(float(family["V"]) for family in gaps.values())
    assert deepest[-1] == pytest.approx(0.0, abs=1e-14)
    assert deepest[-2] < -1e-7 or shaft == 0.0  # by symmetry, two pins touch at once then
