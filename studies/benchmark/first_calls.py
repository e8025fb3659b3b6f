"""Time of imports, first runs, sweeps and derivatives in a fresh Python process.

Each call runs alone in a process on one core, first with an empty cache folder ("nothing kept"),
then with the cache of the first process ("kept"). Times are processor times of the call without the
import.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import clearjoint as cj
from studies.benchmark.chain import chain
from studies.benchmark.table import Plan, Row, on_cores, processor_time, row
from studies.common.fresh_process import ROOT, in_process

SPAN = 0.02
"""Simulated time, s, so short that only the preparation counts."""
LANES, RODS = 8, 8
PLAY = {"crank pin": 0.2e-3, "rocker pin": 0.2e-3}
"""Radial clearances of the four-bar, m."""
IMPORT_AIM, STUDY_AIM = 1.4, 15.0
"""Aims of the import, and of the paper's study without a cache, s."""
FRESH = """
import sys, time
begun = time.process_time()
import clearjoint as cj
imported = time.process_time() - begun
cj.configure(cache=sys.argv[1])
from studies.benchmark.first_calls import print_first_call
print_first_call(sys.argv[2], sys.argv[3], imported)
"""


class OwnLaw(cj.laws.LankaraniNikravesh):
    """Law defined outside the package, which is traced in every process."""


def four_bar() -> tuple[cj.Scene, cj.State]:
    """Return a four-bar at rest with clearance of 0.2 mm at both ends of its coupler, restitution
    0.8 and friction.
    """
    return cj.mechanisms.four_bar(PLAY, 0.8, friction=cj.frictions.RegularisedCoulomb(0.1))


def own_law() -> tuple[cj.Scene, cj.State]:
    """Return the pendulum with a user-defined law."""
    law = OwnLaw(restitution=0.9, stiffness=cj.mechanisms.STEEL)
    return cj.mechanisms.double_pendulum(0.5e-3, law=law)


@dataclass(frozen=True)
class Mechanism:
    """A mechanism, with a joint and a body of it."""

    make: Callable[[], tuple[cj.Scene, cj.State]]
    joint: str
    body: str


MECHANISMS = {
    "pendulum": Mechanism(lambda: cj.mechanisms.double_pendulum(0.5e-3, 0.9), "shoulder", "arm 2"),
    "pendulum with a user's law": Mechanism(own_law, "shoulder", "arm 2"),
    "four-bar": Mechanism(four_bar, "crank pin", "coupler"),
    "eight bodies": Mechanism(lambda: chain(RODS), "joint 1", f"rod {RODS}"),
}


@dataclass(frozen=True)
class FirstCall:
    """A call of a mechanism, and aims of its time without and with a cache, s; a call with a cache
    is not measured if its aim is ``None``.
    """

    mechanism: str
    call: str
    nothing_kept: float
    kept: float | None


QUICK = (FirstCall("pendulum", "simulate", 2.0, 0.5),)
CALLS = (
    *QUICK,
    FirstCall("pendulum", "sweep", 3.0, 0.5),
    FirstCall("pendulum", "sensitivities", 5.0, 0.5),
    FirstCall("pendulum with a user's law", "simulate", 2.0, 2.0),
    FirstCall("four-bar", "simulate", 4.0, 0.5),
    FirstCall("four-bar", "sweep", 6.0, 0.5),
    FirstCall("four-bar", "sensitivities", 10.0, 0.5),
    FirstCall("eight bodies", "sweep", 10.0, 0.5),
)


def rows(plan: Plan) -> list[Row]:
    """Measure the import, each first call, and the paper's study; calls with a cache `rounds`
    times.
    """
    imports: list[float] = []
    found = []
    with on_cores(1):
        for first in QUICK if plan.quick else CALLS:
            label = f"first `{first.call}`, {first.mechanism}"
            with tempfile.TemporaryDirectory() as folder:
                again = plan.rounds if first.kept is not None else 0
                runs = [_measured(folder, first) for _ in range(1 + again)]
            imports += [imported for imported, _ in runs]
            times = np.array([call for _, call in runs])
            found.append(row(f"{label}, nothing kept", times[:1], aim=first.nothing_kept))
            if again:
                found.append(row(f"{label}, kept", times[1:], aim=first.kept))
        if not plan.quick:
            found.append(row("the paper's study, nothing kept", _study(), aim=STUDY_AIM))
    return [row("import", np.array(imports), aim=IMPORT_AIM), *found]


def _measured(folder: str, first: FirstCall) -> tuple[float, float]:
    """Return processor times of the import and of the call, s."""
    imported, call = in_process(FRESH, folder, first.mechanism, first.call)[1]
    return imported, call


def _study() -> np.ndarray:
    """Return the processor time of the whole process, s, (1,)."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "studies.double_pendulum", "--output", folder]
        variables = os.environ | {"CLEARJOINT_CACHE": f"{folder}/cache"}
        before = _time_of_children()
        subprocess.run(command, cwd=ROOT, env=variables, capture_output=True, check=True)
        return np.array([_time_of_children() - before])


def _time_of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def print_first_call(mechanism: str, call: str, imported: float) -> None:
    """Call for the first time in this process, and print its time after that of the import."""
    chosen = MECHANISMS[mechanism]
    scene, state = chosen.make()
    sample = processor_time(lambda: _call(call, chosen, scene, state))
    print(json.dumps([imported, sample.seconds]))


def _call(call: str, mechanism: Mechanism, scene: cj.Scene, state: cj.State) -> int:
    joint, body = mechanism.joint, mechanism.body
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
        times = [0.5 * SPAN, SPAN]
        cj.sensitivities(scene, state, SPAN, parameters, {"y": height}, times, progress=False)
    return 1
