"""Two examples of the Modelica Standard Library, with the values of its reference results.

Their solver ran with a relative tolerance of about 1e-4; clearjoint runs with 1e-11, so that the
differences are errors of the published values.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import xarray as xr

import clearjoint as cj
from clearjoint import plot
from studies.validation.check import Check

SETTINGS = cj.Settings(rtol=1e-11)
ORIGIN, Z = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)


class Example(NamedTuple):
    """An example with its checks, and its motion: `position` and `velocity` over `time`."""

    name: str
    checks: list[Check]
    motion: xr.Dataset


def backlash() -> Example:
    """Run `Rotational.Examples.Backlash`: a wheel released from a compressed flank.

    Inertia 5 kg m^2; stiffness 20e3 N m/rad, damping 50 N m s/rad, backlash pi/4 rad. It starts at
    rest pi/2 rad from the middle. The damping torque is at most the elastic one, so that a flank
    never pulls: it stops pushing before the gap opens.
    """
    name, inertia, play = "Rotational.Examples.Backlash", 5.0, math.pi / 4.0
    stiffness, damping = 20e3, 50.0
    law = cj.laws.ElastoGap(stiffness, damping=damping)
    joints = {
        "hinge": cj.RevoluteJoint("ground", "wheel", ORIGIN, ORIGIN, Z, Z),
        "flanks": cj.Backlash("ground", "wheel", play=play, radius=1.0, law=law),
    }
    scene = cj.Scene({"wheel": cj.Body(1.0, (inertia, inertia, inertia))}, joints)
    start = cj.body_state(ORIGIN, orientation=cj.rotation(Z, math.pi / 2.0))
    angle = cj.quantities.JointAngle("hinge")
    speed = cj.quantities.JointAngularVelocity("hinge")

    def stops_pushing(flank: str) -> cj.Section:
        """Return the section at which the damping torque equals the elastic one."""
        depth = cj.quantities.Penetration("flanks", flank)
        rate = cj.quantities.PenetrationRate("flanks", flank)
        channels = {"speed": (speed, "rad/s")}
        return cj.Section(lambda now: -stiffness * depth(now) - damping * rate(now), channels, 1)

    opens = cj.Section(lambda now: 0.5 * play - angle(now), {"speed": (speed, "rad/s")}, 1)
    sections = {flank: stops_pushing(flank) for flank in ("upper flank", "lower flank")}
    crossings, impacts, motion = _run(
        scene, {"wheel": start}, 0.1, angle, {"opens": opens, **sections}
    )
    first, second = (crossings[f"{side} flank"] for side in ("upper", "lower"))
    at = motion.sel(time=0.05)
    found = {
        "a flank stops pushing": ("s", 0.0236592180, first.times[0]),
        "speed there": ("rad/s", -66.1964949763532, first.values["speed"][0]),
        "its gap opens": ("s", 0.0261592175, crossings["opens"].times[0]),
        "the other flank is met": ("s", 0.0380238663, impacts.onset[0]),
        "angle at 0.05 s": ("rad", -1.07836433, at["position"]),
        "speed at 0.05 s": ("rad/s", -42.5653991, at["velocity"]),
        "the other flank stops pushing": ("s", 0.0853423267, second.times[0]),
        "speed there again": ("rad/s", 52.8937155, second.values["speed"][0]),
        "its gap opens again": ("s", 0.0878524347, impacts.separation[0]),
    }
    return _example(name, found, motion)


def elasto_gap() -> Example:
    """Run `Translational.Examples.ElastoGap`: a mass between two spring-dampers with gaps.

    1 kg; each spring 10 N/m with a damper of 1.5 N s/m, whose force is at most the spring's. The
    mass moves freely for |s| < 0.5 m and starts at rest at 2 m.
    """
    name, free = "Translational.Examples.ElastoGap", 0.5
    walls = cj.PinInSlot(
        "ground",
        "mass",
        slot_axis=(0.0, 1.0, 0.0),
        slot_normal=(1.0, 0.0, 0.0),
        play=2.0 * free,
        pin_radius=5.0,  # m; the penetration of a pin may be up to its radius
        law=cj.laws.ElastoGap(10.0, damping=1.5),
    )
    scene = cj.Scene({"mass": cj.Body(1.0, (1.0, 1.0, 1.0))}, {"walls": walls})
    position, velocity = cj.quantities.Position("mass", "x"), cj.quantities.Velocity("mass", "x")
    opens = cj.Section(lambda now: free - position(now), {"velocity": (velocity, "m/s")}, 1)
    start = cj.body_state((2.0, 0.0, 0.0))
    crossings, impacts, motion = _run(scene, {"mass": start}, 3.0, position, {"opens": opens})
    found = {
        "the gap opens": ("s", 0.58337276, crossings["opens"].times[0]),
        "velocity there": ("m/s", -3.42715020688, crossings["opens"].values["velocity"][0]),
        "the other spring is met": ("s", 0.875160380, impacts.onset[0]),
    }
    return _example(name, found, motion)


def _run(
    scene: cj.Scene,
    bodies: dict[str, cj.BodyState],
    end: float,
    position: cj.extend.Quantity,
    sections: dict[str, cj.Section],
) -> tuple[Mapping[str, cj.results.Crossings], cj.results.Impacts, xr.Dataset]:
    """Return the crossings, the impacts, and `position` with its rate at 1001 times."""
    times = np.linspace(0.0, end, 1001)
    save = cj.Saving(times, impacts=True)
    solution = cj.simulate(scene, cj.State(bodies), end, SETTINGS, save, outputs=sections)
    curves = {
        "position": plot.series(scene, solution, position),
        "velocity": plot.rate_series(scene, solution, position),
    }
    assert solution.impacts is not None
    return solution.outputs, solution.impacts, xr.Dataset(curves)


def _example(name: str, found: dict[str, tuple[str, float, float]], motion: xr.Dataset) -> Example:
    checks = [
        Check(name, key, unit, published, float(ours))
        for key, (unit, published, ours) in found.items()
    ]
    return Example(name, checks, motion)
