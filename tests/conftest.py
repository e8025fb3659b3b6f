"""Runtime settings for all tests, and what tests share: compiling dominates, so share it."""

import ctypes
import gc
import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import jax
import psutil
import pytest
from jax._src.interpreters import mlir

if jax.__version_info__ < (0, 11):  # A later jaxlib ends the process for a flag that it dropped.
    # Tests evaluate thousands of small expressions, each a program of its own, which compile in
    # half the time without these emitters; the programs of runs hold none. To divide the code of a
    # program among threads takes a tenth more processor time, which other workers need.
    flags = "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1"
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {flags}"

from tests.support.shapes import check_shapes  # noqa: E402

check_shapes()

import clearjoint as cj  # noqa: E402
from clearjoint._compilation.program_store import keep_programs  # noqa: E402

_make_context = getattr(mlir, "make_ir_context", None)
_of_thread = threading.local()


def context_of_thread() -> object:
    """The context in which this thread's programs are lowered to XLA. JAX makes another one for
    every program, which takes a third of the time of a small one. A program that is computed while
    another one is lowered has a context of its own, or it would become a part of the other."""
    if mlir.ir.Context.current is not None:
        return _make_context()
    if not hasattr(_of_thread, "context"):
        _of_thread.context = _make_context()
    return _of_thread.context


if jax.__version_info__ < (0, 11):  # An internal function, as it is in these versions.
    mlir.make_ir_context = context_of_thread

gc.freeze()
gc.set_threshold(50_000, 50, 100)
"""Tracing makes so many objects that collecting garbage at the usual rate takes a third of it."""

LONGEST = (
    "conformance",
    "predictor",
    "symmetries_of_elements",
    "wear",
    "slider_crank",
    "identify",
    "primitives",
    "sweep_execution",
    "nonsmooth",
    "sweep_resume",
    "posterior",
    "distribution",
    "architecture",
)
"""Files of tests that take longest: begun first, they leave no worker waiting."""


def pytest_configure(config: pytest.Config) -> None:
    """Have XLA leave out most optimisations in fast tests, which then take less time to compile, in
    processes begun here too."""
    os.environ.setdefault("CLEARJOINT_CACHE", str(Path(__file__).parent.parent / ".cache" / "jax"))
    cj.configure()
    keep_programs(False)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    if config.getoption("markexpr") == "not slow":
        jax.config.update("jax_disable_most_optimizations", True)
        os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] = "1"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest files first."""
    ranks = {f"test_{name}.py": rank for rank, name in enumerate(LONGEST)}
    items.sort(key=lambda item: ranks.get(item.path.name, len(ranks)))


@pytest.fixture(scope="session")
def reference_folder() -> Path:
    """The folder of reference trajectories; see its README."""
    return Path(__file__).parent / "data" / "reference"


MEMORY = 2.5e9
"""Bytes beyond which what is compiled is forgotten; the cache on disk brings it back."""


@pytest.fixture(scope="module", autouse=True)
def bounded_memory() -> Iterator[None]:
    """Compiled programs take some 10 MB each, and hundreds of them add up."""
    yield
    if psutil.Process().memory_info().rss > MEMORY:
        jax.clear_caches()
        vars(_of_thread).clear()
        gc.collect()
        if sys.platform == "linux":
            ctypes.CDLL("libc.so.6").malloc_trim(0)
