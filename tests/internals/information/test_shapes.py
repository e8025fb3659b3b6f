"""The shape of an argument of a function is checked in this suite."""

import jaxtyping
import numpy as np
import pytest

from clearjoint._information.fisher_information import covariance


def test_a_wrong_shape_of_an_argument_is_refused():
    with pytest.raises(jaxtyping.TypeCheckError, match="rows"):
        covariance(np.ones(3))
