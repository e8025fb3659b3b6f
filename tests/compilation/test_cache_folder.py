"""The folder of compiled programs: its owner and permissions, and messages if it is refused."""

import os
from pathlib import Path

import pytest

from clearjoint.compilation.program_store import is_private, prepare_folder


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
