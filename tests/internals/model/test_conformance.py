"""Laws of the package, and one that shares its load, conform."""

import warnings

import pytest

import clearjoint as cj
from clearjoint._model.contact.laws import WeightedLaw
from clearjoint.testing import (
    check_law,
)
from tests.test_conformance import STEEL

LAWS = (
    cj.laws.LankaraniNikravesh(0.0, 1e8, exponent=1.0),
    WeightedLaw(cj.laws.LankaraniNikravesh(0.9, STEEL, smoothing=1e-7), 0.3),
    cj.laws.Hertz(STEEL),
    cj.laws.LankaraniNikravesh(0.9, STEEL),
    cj.laws.LankaraniNikravesh(0.9, STEEL, smoothing=1e-7),
    cj.laws.HuntCrossley(0.5, STEEL),
    cj.laws.Flores2011(0.2, STEEL, exponent=2.0),
    cj.laws.MemorylessHuntCrossley(0.8, STEEL, 0.1),
)


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
def test_laws_conform(law):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_law(law)
