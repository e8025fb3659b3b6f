"""What a user waits for: import, first runs, sweeps and derivatives of a fresh Python.

Run by ``python -m studies.benchmark first-calls``: the paper's double pendulum, a four-bar with two
plays and friction, and eight bodies with clearance; each call alone in a process, first with an
empty cache folder and then with that filled. And the paper's study, as from a fresh clone.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

import clearjoint as cj
from studies.benchmark.chain import chain
from studies.benchmark.four_bar import four_bar
from studies.common.fresh_process import ROOT, in_process
from studies.common.report import Record

SPAN = 0.02
"""Simulated time, s: hardly any, so that what is measured is what comes before."""
LANES = 8
RODS = 8
IMPORT_AIM, STUDY_AIM = 1.4, 20.0
"""s: of processor time for the import, of wall time for the paper's study."""
FRESH = """
import sys, time
wall, processor = time.perf_counter(), time.process_time()
import clearjoint as cj
wall, processor = time.perf_counter() - wall, time.process_time() - processor
cj.configure(cache=sys.argv[1])
from studies.benchmark.first_calls import print_first_call
print_first_call(sys.argv[2], sys.argv[3], wall, processor)
"""
MECHANISMS: dict[str, tuple[Callable[[], tuple[cj.Scene, cj.State]], str, str]] = {
    "double pendulum": (lambda: cj.double_pendulum(0.5e-3, 0.9), "shoulder", "arm 2"),
    "four-bar": (four_bar, "crank pin", "coupler"),
    "eight bodies": (lambda: chain(RODS), "joint 1", f"rod {RODS}"),
}
"""By name what makes it, and a joint and a body of it."""


@dataclass(frozen=True)
class FirstCall:
    """A call of a mechanism, and how much processor time it should take, s: with an empty cache
    folder, and, unless there is no aim for that, with a filled one."""

    mechanism: str
    call: str
    cold: float
    warm: float | None = None


QUICK = (FirstCall("double pendulum", "simulate", 4.0, 1.0),)
CALLS = (
    *QUICK,
    FirstCall("double pendulum", "sweep", 10.0, 1.5),
    FirstCall("double pendulum", "sensitivities", 12.0, 2.0),
    FirstCall("four-bar", "simulate", 6.0, 1.0),
    FirstCall("four-bar", "sweep", 15.0, 2.0),
    FirstCall("four-bar", "sensitivities", 15.0, 2.0),
    FirstCall("eight bodies", "sweep", 25.0),
)


def first_calls(repeats: int, quick: bool = False) -> list[Record]:
    """Times of the import, of each first call and of the paper's study, beside what they should be.

    Those with an empty folder are measured once, the others `repeats` times, of which the least is
    taken. `quick`: the import and the pendulum's first run alone.
    """
    imports: list[Record] = []
    calls = [
        record
        for first in (QUICK if quick else CALLS)
        for record in _with_a_cache(first, repeats, imports)
    ]
    studies = [] if quick else [_record("paper's study", "empty", _study(), STUDY_AIM, "s")]
    return [_record("import", "", _least(imports), IMPORT_AIM), *calls, *studies]


def _record(what: str, cache: str, times: Record, aim: float, of: str = "processor s") -> Record:
    ratio = {"aim": aim, "times the aim": times[of] / aim}
    return {"what": what, "cache": cache, **times, **ratio}


def _with_a_cache(first: FirstCall, repeats: int, imports: list[Record]) -> Iterator[Record]:
    """The call's records; times of the imports are added to `imports`."""
    what = f"{first.mechanism}, {first.call}"
    runs = repeats + 1 if first.warm is not None else 1
    with tempfile.TemporaryDirectory() as folder:
        found = [in_process(FRESH, folder, first.mechanism, first.call)[1] for _ in range(runs)]
    imports += [times["import"] for times in found]
    cold, *warm = (times["call"] for times in found)
    yield _record(what, "empty", cold, first.cold)
    if first.warm is not None:
        yield _record(what, "filled", _least(warm), first.warm)


def _least(times: list[Record]) -> Record:
    return {name: min(one[name] for one in times) for name in times[0]}


def _study() -> Record:
    """Times of the paper's study with an empty cache folder, all of its process."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "studies.double_pendulum", "--output", folder]
        variables = os.environ | {"CLEARJOINT_CACHE": f"{folder}/cache"}
        begun, worked = time.perf_counter(), _processor_time_of_children()
        subprocess.run(command, cwd=ROOT, env=variables, capture_output=True, check=True)
        wall, processor = time.perf_counter() - begun, _processor_time_of_children() - worked
    return {"s": wall, "processor s": processor}


def _processor_time_of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def print_first_call(mechanism: str, call: str, wall: float, processor: float) -> None:
    """Call for the first time, and print how long that takes, beside times of the import."""
    make, joint, body = MECHANISMS[mechanism]
    scene, state = make()
    begun, worked = time.perf_counter(), time.process_time()
    _call(call, scene, state, joint, body)
    took = {"s": time.perf_counter() - begun, "processor s": time.process_time() - worked}
    print(json.dumps({"import": {"s": wall, "processor s": processor}, "call": took}))


def _call(call: str, scene: cj.Scene, state: cj.State, joint: str, body: str) -> None:
    height = cj.quantities.Position(body, "y")
    if call == "simulate":
        cj.simulate(scene, state, SPAN, progress=False)
    elif call == "sweep":
        axis = cj.Axis(lambda s: s.joints[joint].clearance, np.linspace(1e-4, 5e-4, LANES))
        outputs = {"top": cj.Peak(height, "m")}
        cj.sweep(scene, state, SPAN, {"clearance": axis}, outputs, progress=False)
    else:
        parameters = {
            "clearance": cj.Parameter(lambda s: s.joints[joint].clearance, cj.Log()),
            "restitution": cj.Parameter(lambda s: s.joints[joint].law.restitution),
            "mass": cj.Parameter(lambda s: s.bodies[body].mass, cj.Log()),
        }
        cj.sensitivities(scene, state, SPAN, parameters, {"y": height}, [0.5 * SPAN, SPAN])
