"""The catalogue's checks hold, those that take no integration, and each of all has its figure."""

import re
from pathlib import Path

from studies.catalogue import __main__ as catalogue
from studies.catalogue.__main__ import main

README = Path(catalogue.__file__).parent / "README.md"


def test_every_entry_is_as_near_as_it_has_to_be(tmp_path, capsys):
    main(["--quick", "--output", str(tmp_path)])
    last = capsys.readouterr().out.strip().splitlines()[-1].split()
    assert last[0] == last[2] and int(last[0]) > 25


def test_every_entry_has_its_figure():
    """In the table of the README, and the picture lies where the row says."""
    rows = [line.split("|") for line in README.read_text("utf-8").splitlines() if line[:3] == "| `"]
    assert len(rows) > 70
    for row in rows:
        link = re.fullmatch(r" \[[^]]+\]\(([^)]+\.png)\) ", row[-2])
        assert link, row[1]
        assert (README.parent / link[1]).exists(), row[1]
