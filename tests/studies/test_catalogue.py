"""The catalogue: figures of its README; `tests/model/test_catalogue.py` has its errors."""

import re
from pathlib import Path

from studies.catalogue.check import HEAD
from tests.model.test_catalogue import ROWS


def test_every_entry_has_its_figure():
    assert len(ROWS) > 70
    for row in ROWS:
        assert len(row) == len(HEAD), row
        link = re.fullmatch(r"\[[^]]+\]\(([^)]+\.png)\)", row[-1])
        assert link, row
        assert (Path(__file__).parents[2] / "studies" / "catalogue" / link[1]).exists(), row
