"""Presets have the public names that their module gives them."""

import importlib

import clearjoint
from clearjoint._simulation.step import presets as inner


def test_presets_are_a_module_too():
    found = importlib.import_module("clearjoint.presets")
    assert found is clearjoint.presets
    names = {name for name, value in vars(inner).items() if isinstance(value, clearjoint.Settings)}
    assert names == {name for name in vars(found) if not name.startswith("_")}
    assert all(getattr(found, name) is getattr(inner, name) for name in names)
