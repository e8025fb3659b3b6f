"""Detection of changed files and of replaced code of the package in a process."""

import diffrax
import jax.numpy as jnp
import pytest

import clearjoint as cj
from clearjoint.compilation import package_code
from clearjoint.fields import objects
from clearjoint.model.contact import laws
from clearjoint.simulation.step import step_length, stepping


@pytest.fixture
def state(monkeypatch):
    """The recorded state of the package's code, with its present contents."""
    fresh = package_code._State()
    monkeypatch.setattr(package_code, "_STATE", fresh)
    package_code.remember_contents()
    return fresh


def other(*arguments):
    return arguments


NUMBER = next(name for name, value in vars(step_length).items() if type(value) is float)
REPLACED = {
    "a constant": (step_length, NUMBER, 123.0),
    "a function": (stepping, "attempt", other),
    "a method": (cj.frictions.RegularisedCoulomb, "ratio", other),
    "code": (laws.contact_normal_force, "__code__", other.__code__),
    "defaults": (cj.simulate, "__kwdefaults__", {}),
    "a class": (cj, "Body", cj.State),
    "of diffrax": (diffrax.Tsit5, "order", other),
    "of jax": (jnp, "sin", other),
}


@pytest.mark.parametrize("replaced", REPLACED.values(), ids=REPLACED)
def test_replaced_code_is_noticed(state, replaced, monkeypatch):
    """Also after it was restored, since JAX caches programs that were traced with it."""
    assert package_code.source_digest() == package_code.source_digest()
    with monkeypatch.context() as patch:
        patch.setattr(*replaced)
        with pytest.raises(package_code.ChangedCodeError):
            package_code.source_digest()
    with pytest.raises(package_code.ChangedCodeError):
        package_code.source_digest()
    state.changed = False
    assert package_code.source_digest()


def test_new_constants_in_dictionaries_and_new_attributes_are_noticed(state, monkeypatch):
    name = next(iter(objects._COUNTS))
    with monkeypatch.context() as patch:
        patch.setitem(objects._COUNTS, name, None)
        with pytest.raises(package_code.ChangedCodeError):
            package_code.source_digest()
    state.changed = False
    with monkeypatch.context() as patch:
        patch.setattr(cj.frictions.RegularisedCoulomb, "more", other, raising=False)
        with pytest.raises(package_code.ChangedCodeError):
            package_code.source_digest()


def test_the_digest_is_that_of_the_files_when_the_import_began(state, monkeypatch, tmp_path):
    (tmp_path / "module.py").write_text("K = 1.0")
    monkeypatch.setattr(package_code, "_FOLDER", str(tmp_path))
    state.files = package_code._files()
    first = package_code.source_digest()
    (tmp_path / "module.py").write_text("K = 2.0")
    assert package_code.source_digest() == first
    state.modules = 0  # as after the import of a module
    with pytest.raises(package_code.ChangedCodeError):
        package_code.source_digest()
    state.__init__()
    package_code.remember_contents()
    assert package_code.source_digest() != first


def test_a_package_without_files_has_no_digest(state):
    state.files = {}
    with pytest.raises(package_code.ChangedCodeError):
        package_code.source_digest()
