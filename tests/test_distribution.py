"""The wheel and the source archive that users install."""

import os
import subprocess
import tarfile
import zipfile

import pytest

from tests.support.processes import ROOT, printed

BUILD = "import sys; from hatchling import build; print(getattr(build, sys.argv[1])(sys.argv[2]))"


def _built(kind, folder):
    return folder / printed(BUILD, f"build_{kind}", folder).split()[-1]


def _sources():
    listed = ["git", "ls-files", "clearjoint"]
    paths = subprocess.run(listed, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return {path for path in paths.split() if (ROOT / path).exists()}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    return _built("wheel", tmp_path_factory.mktemp("wheel"))


def test_the_wheel_holds_the_package_and_the_licence(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        metadata = next(name for name in names if name.endswith(".dist-info/METADATA"))
        text = archive.read(metadata).decode()
    # The launcher is a module beside the package.
    assert {name for name in _sources() if "launcher" not in name} <= set(names)
    assert "clearjoint_command.py" in names
    assert "License-Expression: Apache-2.0" in text
    assert any(name.endswith("licenses/clearjoint/LICENSE") for name in names)
    assert not any(name.startswith(("tests", "studies", "notebooks")) for name in names)


def test_the_source_archive_holds_the_tests(tmp_path):
    with tarfile.open(_built("sdist", tmp_path)) as archive:
        names = {name.split("/", 1)[-1] for name in archive.getnames()}
    assert _sources() | {"pyproject.toml", "README.md", "tests/test_distribution.py"} <= names


def test_an_installed_wheel_works(wheel, tmp_path):
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path)
    here = {"cwd": tmp_path, "env": {**os.environ, "PYTHONPATH": str(tmp_path)}}
    program = "import clearjoint as cj; print(cj.__file__, len(cj.mechanisms.four_bar()[0].joints))"
    assert printed(program, **here).split() == [str(tmp_path / "clearjoint/__init__.py"), "4"]
    launched = printed("from clearjoint_command import main; main()", "--help", **here)
    assert "clearjoint" in launched and "run" in launched
