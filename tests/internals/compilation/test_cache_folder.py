"""The folder of compiled programs: its owner and permissions, and messages if it is refused."""

import os
from pathlib import Path

import numpy as np
import pytest

from clearjoint._compilation.program_store import ProgramStore, is_private, prepare_folder


def test_a_folder_is_made_for_its_owner_alone(tmp_path):
    folder = tmp_path / "more" / "cache"
    assert prepare_folder(folder) is None and prepare_folder(folder) is None
    assert folder.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o1777, 0o702])
def test_a_folder_to_which_others_may_write_is_refused(tmp_path, mode):
    tmp_path.chmod(mode)
    problem = prepare_folder(tmp_path)
    assert problem is not None and str(tmp_path) in problem and "chmod go-w" in problem
    assert not is_private(tmp_path)


@pytest.mark.parametrize("mode", [0o700, 0o755, 0o500])
def test_a_folder_that_others_may_read_is_used(tmp_path, mode):
    tmp_path.chmod(mode)
    assert prepare_folder(tmp_path) is None and is_private(tmp_path)


def test_a_folder_of_another_user_is_refused_except_the_administrators(tmp_path, monkeypatch):
    owner = tmp_path.stat().st_uid
    monkeypatch.setattr(os, "getuid", lambda: owner + 1)
    assert is_private(tmp_path) == (owner == 0)
    if owner == 0:
        os.chown(tmp_path, 7, -1)
        assert not is_private(tmp_path)


@pytest.mark.parametrize("seed", range(20))
def test_a_folder_that_others_could_exchange_is_refused(tmp_path, seed):
    """Others may, if they may write to any folder above it, unless that has the sticky bit. A link
    on the way counts with the folders on both sides."""
    rng, folders, exposed = np.random.default_rng(seed), [], []
    folder = tmp_path
    for depth in range(4):
        folder = folder / f"{depth}"
        folder.mkdir()
        if rng.random() < 0.3:
            link = folder.with_name(f"{depth} link")
            link.symlink_to(folder)
            folder = link
        folders.append(folder)
    (cache := folder / "cache").mkdir(mode=0o700)
    for above in folders:
        mode = int(
            rng.choice([0o700, 0o755, 0o1777, 0o1770, 0o777, 0o775], p=[0.3] * 3 + [0.1 / 3] * 3)
        )
        above.chmod(mode)
        if mode in (0o777, 0o775):
            exposed.append(above.resolve())
    problem = prepare_folder(cache)
    assert is_private(cache) == (problem is None) == (not exposed)
    if problem is not None:
        named = {Path(part) for part in problem.split("'") if part.startswith("/")}
        assert "chmod go-w" in problem and {path.resolve() for path in named} & set(exposed)


def test_folders_above_are_made_for_their_owner_even_with_a_generous_umask(tmp_path):
    before = os.umask(0)
    try:
        assert prepare_folder(tmp_path / "a" / "b" / "cache") is None
    finally:
        os.umask(before)


def test_a_program_to_which_others_may_write_is_not_read(tmp_path):
    store = ProgramStore(tmp_path / "cache")
    store.write("k", b"code")
    assert store.read("k") == b"code"
    (file,) = (tmp_path / "cache").iterdir()
    file.chmod(0o666)
    assert store.read("k") is None


@pytest.mark.parametrize("path", ["file", "file/inside"])
def test_the_error_names_a_file_with_that_path(tmp_path, path):
    (tmp_path / "file").touch()
    with pytest.raises(ValueError, match=f"{tmp_path}/{path}' is a file, or lies in one: remove"):
        prepare_folder(tmp_path / path)


def test_the_reason_why_a_folder_cannot_be_made_is_returned(tmp_path, monkeypatch):
    def refuses(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "mkdir", refuses)
    assert "can't be made (Permission denied)" in str(prepare_folder(tmp_path / "cache"))
