"""The reference pages: equations and names in the text, and all names on some page."""

import re
import subprocess
import sys

import pytest

from clearjoint.reference.groups import GROUPS, grouped
from clearjoint.reference.public_names import PublicName, public_names
from clearjoint.reference.text import fenced, without_equations
from tests.support.rooms import PACKAGE


def test_every_name_has_one_page():
    pages = grouped(public_names())
    assert set(pages) == {group.page for group in GROUPS}
    places = [public.name for held in pages.values() for public in held]
    assert {public.name for public in public_names()} == set(places)


def test_a_name_without_a_page_is_told():
    stray = PublicName("lost", "clearjoint", "clearjoint.nowhere.at_all", None, "")
    with pytest.raises(ValueError, match=r"place for lost.*groups\.py"):
        grouped([stray])


def test_sessions_are_fenced_and_literals_keep_their_dollars():
    assert fenced("Text.\n\n>>> 1\n1\n\nMore.") == "Text.\n\n```pycon\n>>> 1\n1\n```\n\nMore."
    pytest.importorskip("latex2mathml")
    text, marks = without_equations(r"The $\chi$ of `$x$` and 5 $ or 6 $.")
    (name,) = marks
    assert text == f"The {name} of `$x$` and 5 $ or 6 $."
    assert "&#x003C7;" in marks[name]
    with pytest.raises(ValueError, match="can't be rendered"):
        without_equations(r"$x_a_b$")


@pytest.mark.slow
def test_one_command_writes_pages_that_need_no_network(tmp_path):
    pytest.importorskip("pdoc")
    command = [sys.executable, "-m", "clearjoint.reference", str(tmp_path)]
    done = subprocess.run(command, cwd=PACKAGE.parent, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str(tmp_path / "index.html")
    assert "Traceback" not in done.stderr
    pages = {path.stem: path.read_text(encoding="utf-8") for path in tmp_path.glob("*.html")}
    for page, held in grouped(public_names()).items():
        for public in held:
            assert f'id="{public.name}"' in pages[page], public
            assert f'href="{page}.html#{public.name}"' in pages["index"], public
    assert "<math" in pages["contact-laws"] and "$$" not in pages["contact-laws"]
    for text in pages.values():
        assert re.findall(r'(?:src|href)="https?://(?!pdoc\.dev)', text) == []
        assert "EQUATION" not in text
