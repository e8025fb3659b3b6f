"""Numbers beyond floats, and names in files that would import something."""

import sys

import numpy as np
import pytest

from clearjoint._scene_files.documents import FileLocation
from clearjoint._scene_files.reading import number_of_text
from tests.scene_files import test_reading
from tests.scene_files.test_reading import PIN

read = test_reading.read


@pytest.mark.parametrize(
    ("text", "number"),
    [("1e-999 mm", 0.0), ("1e-9999999999999999999999 mm", 0.0), ("-inf km", -np.inf)],
)
def test_numbers_beyond_the_range_of_floats(text, number):
    assert number_of_text(text, "m", FileLocation("here")) == number


def test_a_file_imports_nothing(read, tmp_path, monkeypatch):
    (tmp_path / "my_laws.py").write_text("raise SystemExit('imported')")
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("my_laws:Quadratic", "os:system", "clearjoint._model.contact.laws:Hertz"):
        with pytest.raises(ValueError, match=r"none: import it and pass classes=\["):
            read(PIN, ("LankaraniNikravesh", name))
    assert "my_laws" not in sys.modules
