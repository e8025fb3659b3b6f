"""Presets are arguments of `simulate`, `sweep` and `Integration`, and cannot be changed."""

import inspect

import pytest

import clearjoint as cj
from clearjoint import presets

NAMES = ("look", "study", "reference")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("function", [cj.simulate, cj.sweep, cj.Integration])
def test_presets_are_arguments_of_what_runs(function, name):
    preset = getattr(presets, name)
    bound = inspect.signature(function).bind_partial(**preset)
    assert bound.arguments == dict(preset)


@pytest.mark.parametrize("name", NAMES)
def test_presets_cannot_be_changed(name):
    with pytest.raises(TypeError):
        getattr(presets, name)["rtol"] = 1.0


def test_presets_get_finer():
    tolerances = [getattr(presets, name)["rtol"] for name in NAMES]
    assert tolerances == sorted(tolerances, reverse=True)
