"""A law that shares the load with others conforms."""

import warnings

import pytest

import clearjoint as cj
from clearjoint._model.contact.laws import WeightedLaw
from clearjoint.testing import check_law


@pytest.mark.slow
def test_a_law_of_a_part_of_the_load_conforms():
    stiffness = cj.laws.RavnStiffness(207e9, 0.3)
    law = WeightedLaw(cj.laws.LankaraniNikravesh(0.9, stiffness, smoothing=1e-7), 0.3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_law(law)
