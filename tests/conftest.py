"""Runtime settings for all tests, and what tests share: compiling dominates, so share it."""

import os
from collections.abc import Iterator
from pathlib import Path

import jax
import psutil
import pytest

os.environ.setdefault("CLEARJOINT_CACHE", str(Path(__file__).parent.parent / ".cache" / "jax"))

from tests.support.shapes import check_shapes  # noqa: E402

check_shapes()

import clearjoint as cj  # noqa: E402

cj.configure()

REFERENCE = Path(__file__).resolve().parents[2] / "shared" / "reference"


LONGEST = ("notebook", "simulate", "slider_crank_study", "sweep_study", "reference", "sweep")
"""Files of tests that take a minute or more each: begun first, they leave no worker waiting."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest files first."""
    ranks = {f"test_{name}.py": rank for rank, name in enumerate(LONGEST)}
    items.sort(key=lambda item: ranks.get(item.path.name, len(ranks)))


@pytest.fixture(scope="session")
def reference_folder() -> Path:
    """The folder of reference trajectories, which lies beside the checkout."""
    if not REFERENCE.is_dir():
        pytest.skip(f"the reference trajectories are not there: {REFERENCE} is missing")
    return REFERENCE


MEMORY = 2.5e9
"""Bytes beyond which what is compiled is forgotten; the cache on disk brings it back."""


@pytest.fixture(scope="module", autouse=True)
def bounded_memory() -> Iterator[None]:
    """Compiled programs take some 10 MB each, and hundreds of them add up."""
    yield
    if psutil.Process().memory_info().rss > MEMORY:
        jax.clear_caches()
