"""The command for the reference pages writes all public names."""

import subprocess
import sys

import pytest

from tests.support.public_names import public_names
from tests.support.rooms import PACKAGE


@pytest.mark.slow
def test_one_command_writes_every_public_name(tmp_path):
    pytest.importorskip("pdoc")
    command = [sys.executable, "-m", "clearjoint.reference", str(tmp_path)]
    done = subprocess.run(command, cwd=PACKAGE.parent, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str(tmp_path / "clearjoint.html")
    assert done.stderr == ""
    for public in public_names():
        page = (tmp_path / f"{public.source}.html").read_text(encoding="utf-8")
        assert f'id="{public.name}"' in page, public
    # The package's page begins with what is learned first.
    page = (tmp_path / "clearjoint.html").read_text(encoding="utf-8")
    order = [page.index(f'<section id="{name}"') for name in ("Scene", "simulate", "sweep", "wear")]
    assert order == sorted(order) and order[0] < page.index('<section id="Accelerometer"')
