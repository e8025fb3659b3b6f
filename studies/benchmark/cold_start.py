"""Costs that show only in a fresh Python: a first result, and other compiler options.

Run by ``python -m studies.benchmark first-result`` and ``options``.
"""

import json
import tempfile
import time
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

import clearjoint as cj
from studies.common.fresh_process import in_process

FIRST_RESULT = """
import json, sys, time
times = [time.perf_counter()]
import clearjoint as cj
times.append(time.perf_counter())
cj.configure(cache=sys.argv[1])
scene, state = cj.double_pendulum(0.5e-3, 0.9)
for _ in range(2):
    cj.simulate(scene, state, 4.0, cj.Settings(rtol=1e-6), progress=False)
    times.append(time.perf_counter())
print(json.dumps([after - before for before, after in zip(times, times[1:])]))
"""
_TIMES = (
    "process, s",
    "import, s",
    "configure and first run, s",
    "second run, s",
)

UNDER_THESE_FLAGS = (
    "from studies.benchmark.cold_start import under_these_flags; under_these_flags()"
)
_EXTRA = "--xla_backend_extra_options=xla_cpu_"
OPTIONS = {
    "neither": "",
    "loop option": _EXTRA + "small_while_loop_byte_threshold=10000000",
    "fusion option": _EXTRA + "use_multi_output_fusion=true",
    "`clearjoint.XLA_FLAGS`": cj.XLA_FLAGS,
}
"""Values of ``XLA_FLAGS`` by name."""


def first_results(repeats: int) -> list[dict[str, Any]]:
    """Times with an empty cache folder and then with that filled, a new one every time."""
    found = []
    for _ in range(repeats):
        with tempfile.TemporaryDirectory() as folder:
            for cache in ("empty", "filled"):
                process, parts = in_process(FIRST_RESULT, folder)
                times = zip(_TIMES, (process, *parts), strict=True)
                found.append({"cache": cache, **dict(times)})
    return found


def option_costs(repeats: int) -> list[dict[str, Any]]:
    """Costs by compiler options, in turn; without a compilation cache."""
    found = []
    for _ in range(repeats):
        for name, flags in OPTIONS.items():
            with tempfile.TemporaryDirectory() as folder:
                flags = f"{flags} --xla_dump_to={folder}"
                variables = {"JAX_ENABLE_X64": "1", "XLA_FLAGS": flags}
                _, costs = in_process(UNDER_THESE_FLAGS, **variables)
                loops = native_loops(Path(folder))
                found.append({"options": name, **costs, "native loops": loops})
    return found


def native_loops(dumped: Path) -> int:
    """Loops that XLA compiled to one native function, in all programs dumped into a folder.

    In others it starts a kernel for each fusion of each turn.
    """
    programs = dumped.glob("*cpu_after_optimizations.txt")
    return sum(program.read_text().count("xla_cpu_small_call") for program in programs)


def under_these_flags() -> None:
    """Print what a first call and an attempt cost under `jax.jit`, over 1 s, the best of three."""
    scene, state = cj.double_pendulum(0.5e-3, 0.9)

    @jax.jit
    def attempts(end_time: jax.Array) -> jax.Array:
        settings = cj.Settings(rtol=1e-6)
        return cj.simulate(scene, state, end_time, settings, progress=False).attempts

    def run(end_time: float) -> tuple[float, int]:
        start = time.perf_counter()
        count = int(attempts(jnp.asarray(end_time)))
        return time.perf_counter() - start, count

    compiling, _ = run(1e-4)
    cost = min(seconds / attempts for seconds, attempts in (run(1.0) for _ in range(3)))
    print(json.dumps({"first call, s": compiling, "µs an attempt": 1e6 * cost}))
