"""Detection of changed files and of replaced code of the package in a process."""

import pytest

import clearjoint as cj
from clearjoint._compilation import package_code
from clearjoint._simulation.step import step_length, stepping


@pytest.fixture
def recorded(monkeypatch):
    """The package's code is recorded with its present contents, until the test ends."""
    monkeypatch.setattr(package_code, "_contents", [])
    package_code.remember_contents()


def other(*arguments):
    return arguments


NUMBER = next(name for name, value in vars(step_length).items() if type(value) is float)
REPLACED = {
    "a constant": (step_length, NUMBER, 123.0),
    "a function": (stepping, "attempt", other),
    "a class": (cj, "Body", cj.State),
    "a method": (cj.frictions.RegularisedCoulomb, "ratio", other),
    "a special method": (cj.quantities.Position, "__call__", other),
    "an inherited method": (cj.laws.HuntCrossley, "onset_offset", other),
}


@pytest.mark.parametrize("replaced", REPLACED.values(), ids=REPLACED)
def test_replaced_code_is_noticed(recorded, replaced, monkeypatch):
    """Also after it was restored, since JAX caches programs that were traced with it."""
    assert package_code.source_digest() == package_code.source_digest()
    with monkeypatch.context() as patch:
        patch.setattr(*replaced, raising=False)
        with pytest.raises(package_code.ChangedCodeError):
            package_code.source_digest()
    with pytest.raises(package_code.ChangedCodeError):
        package_code.source_digest()
    package_code.remember_contents()
    assert package_code.source_digest()


def test_changed_files_are_noticed(recorded, monkeypatch, tmp_path):
    file = tmp_path / "module.py"
    file.write_text("K = 1.0")
    monkeypatch.setattr(package_code, "_FOLDER", str(tmp_path))
    monkeypatch.setattr(package_code, "_FILES", package_code._files())
    package_code._digest.cache_clear()
    first = package_code.source_digest()
    file.write_text("K = 2.0")
    for _ in range(2):
        with pytest.raises(package_code.ChangedCodeError):
            package_code.source_digest()
    package_code.remember_contents()
    monkeypatch.setattr(package_code, "_FILES", package_code._files())
    package_code._digest.cache_clear()
    assert package_code.source_digest() != first
    package_code._digest.cache_clear()


def test_a_package_without_files_has_no_digest(recorded, monkeypatch):
    monkeypatch.setattr(package_code, "_files", dict)
    monkeypatch.setattr(package_code, "_FILES", {})
    with pytest.raises(package_code.ChangedCodeError):
        package_code.source_digest()
