"""Results that are cached by numbers."""

from concurrent.futures import ThreadPoolExecutor

import jax
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._fields.caching import KEPT, cached_by_numbers


@pytest.fixture
def counted():
    """A cached function, and the list of its calls."""
    calls: list[object] = []

    @cached_by_numbers
    def function(tree):
        calls.append(tree)
        if isinstance(tree, float) and tree < 0.0:
            raise ValueError("negative")
        return len(calls)

    return function, calls


def test_results_are_cached_by_numbers(counted):
    function, calls = counted
    body = cj.Body(1.0, (1.0, 1.0, 1.0))
    assert function(body) == function(cj.Body(1.0, (1.0, 1.0, 1.0))) == 1
    assert function(cj.set_value(body, lambda b: b.mass, 2.0)) == 2
    assert function({"body": body}) == 3
    numbers = np.ones(3)
    assert function(numbers) == 4
    numbers[0] = 2.0
    assert function(numbers) == 5
    assert len(calls) == 5


def test_errors_and_results_of_traced_numbers_are_not_cached(counted):
    function, calls = counted
    for _ in range(2):
        with pytest.raises(ValueError, match="negative"):
            function(-1.0)
    jax.eval_shape(lambda x: (function([x]), function([x]), x)[2], 1.0)
    assert len(calls) == 4


def test_the_least_recently_used_results_are_removed(counted):
    function, calls = counted
    for number in range(KEPT + 1):
        function(float(number))
    function(float(KEPT))
    assert len(calls) == KEPT + 1
    function(0.0)
    assert len(calls) == KEPT + 2


def test_threads_share_a_full_cache():
    function = cached_by_numbers(lambda x: 2.0 * x)
    numbers = np.arange(2.0 * KEPT)
    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(function, np.tile(numbers, 8))) == [*np.tile(2.0 * numbers, 8)]
