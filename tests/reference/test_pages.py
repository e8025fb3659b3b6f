"""Pages of the documentation: all public names, guides and studies, and no dead links."""

import os
import subprocess
import sys
import tomllib
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from tests.support.public_names import public_names
from tests.support.rooms import PACKAGE

ROOT = PACKAGE.parent
SITE = tomllib.loads((PACKAGE / "reference" / "site.toml").read_text(encoding="utf-8"))
WHERE = "see clearjoint/reference/site.toml"


def test_every_public_name_is_on_one_page():
    shown = [
        f"{page['module']}.{name}"
        for page in SITE["api"].values()
        for names in page.get("names", {}).values()
        for name in names.split()
    ]
    assert len(shown) == len(set(shown)), WHERE
    assert set(shown) == {f"{public.source}.{public.name}" for public in public_names()}, WHERE


def test_every_guide_and_study_has_a_page():
    text = (PACKAGE / "reference" / "site.toml").read_text(encoding="utf-8")
    written = [*ROOT.glob("notebooks/*.ipynb"), *ROOT.glob("studies/**/README.md")]
    missing = [str(p.relative_to(ROOT)) for p in written if f'"{p.relative_to(ROOT)}"' not in text]
    assert missing == [], WHERE


def test_docstrings_become_markdown_with_links():
    pytest.importorskip("griffe")
    from clearjoint.reference.docstrings import SESSION, with_links

    assert with_links("see `Peak`") == "see [`Peak`][clearjoint.Peak]"
    assert with_links("`laws.Hertz`, `cj.load`") == (
        "[`laws.Hertz`][clearjoint.laws.Hertz], [`cj.load`][clearjoint.load]"
    )
    assert with_links("`View.save(file)`") == "[`View.save(file)`][clearjoint.View]"
    assert with_links("`path`", "clearjoint.plot") == "[`path`][clearjoint.plot.path]"
    for unchanged in ("`load`", "`path`", "`x`", "[`Peak`][elsewhere]", "```python\n`Peak`\n```"):
        assert with_links(unchanged) == unchanged
    found = SESSION.findall("Text.\n\n>>> 1 + 1\n2\n>>> 3\n3\n\nText.")
    assert len(found) == 1


class Page(HTMLParser):
    """The anchors and the local links of a page."""

    def __init__(self, file):
        super().__init__()
        self.anchors, self.links = {""}, []
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.anchors.add(given.get("id"))
        links = [urlsplit(given[key]) for key in ("href", "src") if key in given]
        self.links += [link for link in links if not link.scheme]


@pytest.mark.slow
def test_one_command_writes_pages_without_dead_links(tmp_path):
    pytest.importorskip("zensical")
    command = [sys.executable, "-m", "clearjoint.reference", "--out", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.split()[-1] == str(tmp_path / "index.html")
    pages = {file: Page(file) for file in tmp_path.rglob("*.html") if file.name != "404.html"}
    for file, page in pages.items():
        for link in page.links:
            target = Path(os.path.normpath(file.parent / unquote(link.path))) if link.path else file
            assert target.is_file(), (file, link)
            anchors = pages[target].anchors if target in pages else {unquote(link.fragment)}
            assert unquote(link.fragment) in anchors, (file, link)
        # References that mkdocstrings or the formulas' converter left as they were.
        text = file.read_text(encoding="utf-8")
        assert "][clearjoint" not in text and "arithmatex" not in text, file
    anchors = set().union(*(page.anchors for page in pages.values()))
    assert {f"{public.source}.{public.name}" for public in public_names()} <= anchors
    # The search finds names from files, too.
    assert "LankaraniNikravesh" in (tmp_path / "search.js").read_text(encoding="utf-8")
