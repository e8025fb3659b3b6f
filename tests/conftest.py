"""Runtime settings for all tests, and what tests share: compiling dominates, so share it."""

import ctypes
import functools
import gc
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import llvmlite.binding as llvm
import psutil
import pytest

if jax.__version_info__ < (0, 11):  # A later jaxlib ends the process for a flag that it dropped.
    # Tests evaluate thousands of small expressions, each a program of its own, which compile in
    # half the time without these emitters; the programs of runs hold none. To divide the code of a
    # program among threads takes a tenth more processor time, which other workers need.
    flags = "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1"
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {flags}"

from tests.support.shapes import check_shapes  # noqa: E402

check_shapes()

import clearjoint as cj  # noqa: E402
from clearjoint._compilation import keep_programs  # noqa: E402

gc.freeze()
gc.set_threshold(50_000, 50, 100)
"""Tracing makes so many objects that collecting garbage at the usual rate takes a third of it."""

LONGEST = (
    "wear",
    "symmetries_of_elements",
    "conformance",
    "sweep",
    "sweep_resume",
    "posterior",
    "simulate",
    "command_line",
    "profiles",
)
"""Files of tests that take longest: begun first, they leave no worker waiting."""


def pytest_configure(config: pytest.Config) -> None:
    """Have XLA and LLVM leave out most optimisations in fast tests, which then take half the time
    to compile; XLA in processes begun here too. LLVM's level changes no bit of native code
    (`test_optimisation.py`). The cache of fast tests is their own, since the keys of programs tell
    no levels apart that are changed here."""
    is_fast = config.getoption("markexpr") == "not slow"
    cache = Path(__file__).parent.parent / ".cache" / ("fast" if is_fast else "jax")
    os.environ.setdefault("CLEARJOINT_CACHE", str(cache))
    cj.configure()
    keep_programs(False)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    if is_fast:
        jax.config.update("jax_disable_most_optimizations", True)
        os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] = "1"
        compile_at_level_zero()


def compile_at_level_zero() -> None:
    """Have LLVM compile native code at level 0, which takes a fifth of the time of level 2. Such
    code runs for 1.7 times as long, which is little beside compiling in most tests."""
    options, machine = llvm.create_pipeline_tuning_options, llvm.Target.create_target_machine

    @functools.wraps(options)
    def options_at_zero(speed_level: int = 0) -> llvm.PipelineTuningOptions:
        return options(speed_level=0)

    @functools.wraps(machine)
    def machine_at_zero(target: llvm.Target, **given: Any) -> llvm.TargetMachine:
        return machine(target, **{**given, "opt": 0})

    llvm.create_pipeline_tuning_options = options_at_zero
    llvm.Target.create_target_machine = machine_at_zero


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
        gc.collect()
        if sys.platform == "linux":
            ctypes.CDLL("libc.so.6").malloc_trim(0)
