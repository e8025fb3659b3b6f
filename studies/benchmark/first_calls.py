"""What a user waits for: the first run, sweep and derivatives of a fresh Python.

Run by ``python -m studies.benchmark first-calls``: the paper's double pendulum, and a four-bar with
two plays and friction; each call alone in a process, first with an empty cache folder and then with
that filled.
"""

import json
import math
import tempfile
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import clearjoint as cj
from studies.common.fresh_process import in_process
from studies.common.report import Record

SPAN = 0.02
"""Simulated time, s: hardly any, so that what is measured is what comes before."""
LANES = 8
FRESH = """
import sys, time
wall, processor = time.perf_counter(), time.process_time()
import clearjoint as cj
wall, processor = time.perf_counter() - wall, time.process_time() - processor
cj.configure(cache=sys.argv[1])
from studies.benchmark.first_calls import print_first_call
print_first_call(sys.argv[2], sys.argv[3], wall, processor)
"""


def four_bar() -> tuple[cj.Scene, cj.State]:
    """A four-bar of 0.1, 0.3 and 0.25 m on feet 0.3 m apart, whose coupler has play at both ends,
    with friction; and its state at rest."""
    foot, crank = np.array([0.3, 0.0, 0.0]), 0.1 * np.array([math.cos(0.9), math.sin(0.9), 0.0])
    across = foot - crank
    reach = float(np.linalg.norm(across))
    along = (0.3**2 - 0.25**2 + reach**2) / (2.0 * reach)
    normal = np.array([-across[1], across[0], 0.0]) / reach
    tip = crank + along * across / reach + math.sqrt(0.3**2 - along**2) * normal
    bodies = {
        name: cj.Body(mass, (1e-5, mass * length**2 / 12, mass * length**2 / 12))
        for name, mass, length in (
            ("crank", 0.2, 0.1),
            ("coupler", 0.4, 0.3),
            ("rocker", 0.35, 0.25),
        )
    }
    origin, axis = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)

    def play(bearing: str, journal: str, here: float, there: float) -> cj.ClearanceJoint:
        return cj.ClearanceJoint(
            bearing,
            journal,
            bearing_point=(here, 0.0, 0.0),
            journal_point=(there, 0.0, 0.0),
            bearing_radius=10e-3,
            clearance=0.2e-3,
            journal_length=20e-3,
            law=cj.LankaraniNikravesh(restitution=0.8, stiffness=cj.RavnStiffness(207e9, 0.3)),
            friction=cj.RegularisedCoulomb(0.1),
        )

    def hinge(body: str, here: tuple[float, ...], there: float) -> cj.RevoluteJoint:
        return cj.RevoluteJoint("ground", body, here, (there, 0.0, 0.0), axis, axis)

    joints = {
        "crank foot": hinge("crank", origin, -0.05),
        "crank pin": play("crank", "coupler", 0.05, -0.15),
        "rocker pin": play("coupler", "rocker", 0.15, 0.125),
        "rocker foot": hinge("rocker", (0.3, 0.0, 0.0), -0.125),
    }

    def between(start: np.ndarray, end: np.ndarray) -> cj.BodyState:
        half = 0.5 * math.atan2(end[1] - start[1], end[0] - start[0])
        return cj.body_state(0.5 * (start + end), (math.cos(half), 0.0, 0.0, math.sin(half)))

    ends = {"crank": (np.zeros(3), crank), "coupler": (crank, tip), "rocker": (foot, tip)}
    state = cj.State({name: between(*points) for name, points in ends.items()})
    return cj.Scene(bodies, joints, gravity=(0.0, -9.81, 0.0)), state


MECHANISMS: dict[str, tuple[Callable[[], tuple[cj.Scene, cj.State]], str, str]] = {
    "double pendulum": (lambda: cj.double_pendulum(0.5e-3, 0.9), "shoulder", "arm 2"),
    "four-bar": (four_bar, "crank pin", "coupler"),
}
"""By name what makes it, and a joint and a body of it."""
CALLS = ("simulate", "sweep", "sensitivities")


def first_calls(repeats: int) -> list[dict[str, Any]]:
    """Times of each first call with an empty cache folder, and the least with that filled."""
    return [
        {"mechanism": mechanism, "call": call, "cache": cache, **times}
        for mechanism in MECHANISMS
        for call in CALLS
        for cache, times in _with_a_cache(mechanism, call, repeats)
    ]


def _with_a_cache(mechanism: str, call: str, repeats: int) -> list[tuple[str, Record]]:
    with tempfile.TemporaryDirectory() as folder:
        cold, *warm = (in_process(FRESH, folder, mechanism, call)[1] for _ in range(repeats + 1))
        least = {name: min(times[name] for times in warm) for name in cold}
        return [("empty", cold), ("filled", least)]


def print_first_call(mechanism: str, call: str, wall: float, processor: float) -> None:
    """Call for the first time, and print how long that takes, beside times of the import."""
    make, joint, body = MECHANISMS[mechanism]
    scene, state = make()
    begun, worked = time.perf_counter(), time.process_time()
    _call(call, scene, state, joint, body)
    times = {
        "import, s": wall,
        "import, processor s": processor,
        "call, s": time.perf_counter() - begun,
        "call, processor s": time.process_time() - worked,
    }
    print(json.dumps(times))


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
