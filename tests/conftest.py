"""Runtime settings for all tests, and what tests share: compiling dominates, so share it."""

import ctypes
import gc
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import jax
import psutil
import pytest

os.environ.setdefault("CLEARJOINT_CACHE", str(Path(__file__).parent.parent / ".cache" / "jax"))
os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_cpu_use_fusion_emitters=false"
# Tests evaluate thousands of small expressions, each a program of its own, which compile in half
# the time without these emitters; the programs of runs hold none.

from tests.support.shapes import check_shapes  # noqa: E402

check_shapes()

import clearjoint as cj  # noqa: E402
from clearjoint.compilation import keep_programs  # noqa: E402

cj.configure()
keep_programs(False)
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)

gc.freeze()
gc.set_threshold(50_000, 50, 100)
"""Tracing makes so many objects that collecting garbage at the usual rate takes a third of it."""

REFERENCE = Path(__file__).resolve().parents[2] / "shared" / "reference"


LONGEST = (
    "notebook",
    "slider_crank_study",
    "simulate",
    "tolerance_study",
    "sweep_study",
    "sweep_resume",
    "sweep_execution",
)
"""Files of tests that take longest: begun first, they leave no worker waiting."""


def compile_quickly(quickly: bool) -> None:
    """Whether JAX compiles, here and in processes begun here, without most optimisations: half the
    time of compiling, and runs that take twice as long."""
    if quickly != jax.config.read("jax_disable_most_optimizations"):
        jax.config.update("jax_disable_most_optimizations", quickly)
        jax.clear_caches()
    os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] = str(int(quickly))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put files marked `optimised` first, since what is compiled is forgotten after them, and then
    the longest."""
    ranks = {f"test_{name}.py": rank for rank, name in enumerate(LONGEST)}

    def rank(item: pytest.Item) -> tuple[bool, int]:
        marked = item.get_closest_marker("optimised") is not None
        return not marked, ranks.get(item.path.name, len(ranks))

    items.sort(key=rank)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Slow tests run long, and files marked `optimised` are about what compiling makes: they have
    the programs that users have. All others compile quickly. Fixtures come after this."""
    fast = item.config.getoption("markexpr") == "not slow"
    compile_quickly(fast and item.get_closest_marker("optimised") is None)


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
        gc.collect()
        if sys.platform == "linux":
            ctypes.CDLL("libc.so.6").malloc_trim(0)
