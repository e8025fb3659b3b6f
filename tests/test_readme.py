"""The README's Python, from top to bottom in one session, as a reader would run it."""

import re
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

import clearjoint as cj

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
LINES = 150


def test_it_is_read_in_a_few_minutes():
    assert README.count("\n") <= LINES


def test_links_and_pictures_lead_somewhere():
    for page in (ROOT / "README.md", *(ROOT / "studies").rglob("README.md")):
        links = re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8"))
        missing = [
            link for link in links if "://" not in link and not (page.parent / link).exists()
        ]
        assert missing == [], page


@pytest.mark.slow
def test_all_python_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    names = {}
    for block in blocks:
        exec(block, names)
    plt.close("all")
    assert len(blocks) == 3
    assert int((names["sweep"]["result"] != 0).sum()) == 0
    assert names["fit"].ending is cj.results.Ending.CONVERGED
