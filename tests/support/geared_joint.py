"""A geared joint with play, friction and gravity, simulated by SciPy: two inertias and a dead band.

A rotor with armature, dry and viscous friction is driven by a torque. A spring and damper with a
dead band of the play connects it with a link that hangs from the joint.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

RATE = 200.0  # Hz, of the log
COUNTS = 4096  # of a 12 bit encoder per revolution
URDF = """<robot name="rig"><link name="base"/>
<link name="arm"><inertial><origin xyz="0 0 -0.25"/><mass value="1"/>
<inertia ixx="0.01" iyy="{inertia}" izz="0.01"/></inertial></link>
<joint name="elbow" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
</joint></robot>"""


@dataclass(frozen=True)
class GearedJoint:
    """Numbers in SI units; `inertia` is about the centre of mass, `length` from the joint to it."""

    armature: float = 0.02
    mass: float = 1.0
    length: float = 0.25
    inertia: float = 0.01
    friction: float = 0.25
    damping: float = 0.05
    play: float = np.deg2rad(0.5)
    stiffness: float = 2000.0
    flank_damping: float = 5.0

    def motion(self, times, torque, start=0.0):
        """Angles of rotor and link, rad, at times, s, for a torque, N m, as a function of time. The
        link starts at rest at an angle, rad, where gravity presses it to a flank."""
        about_joint = self.inertia + self.mass * self.length**2
        weight = self.mass * 9.81 * self.length
        held, half = weight * np.sin(start), 0.5 * self.play
        ahead = np.sign(held) * half + held / self.stiffness

        def rates(t, y):
            rotor, link, rotor_speed, link_speed = y
            twist, rate = link - rotor, link_speed - rotor_speed
            if twist > half:
                gear = max(self.stiffness * (twist - half) + self.flank_damping * rate, 0.0)
            elif twist < -half:
                gear = min(self.stiffness * (twist + half) + self.flank_damping * rate, 0.0)
            else:
                gear = 0.0
            resisting = self.friction * np.tanh(rotor_speed / 1e-5) + self.damping * rotor_speed
            of_rotor = (torque(t) - resisting + gear) / self.armature
            return rotor_speed, link_speed, of_rotor, (-weight * np.sin(link) - gear) / about_joint

        y0 = start + ahead, start, 0.0, 0.0
        options = {"t_eval": times, "rtol": 1e-8, "atol": 1e-10, "max_step": 2e-3}
        solution = solve_ivp(rates, (times[0], times[-1]), y0, method="LSODA", **options)
        assert solution.success
        return solution.y[:2]


def swinging(seed, end, size=0.9):
    """Times, s, and torques, N m: four sines of random phases, which begin within 0.3 s."""
    generator = np.random.default_rng(seed)
    times = np.arange(round(end * RATE) + 1) / RATE
    frequencies = np.array([0.4, 0.9, 1.7, 2.9]) * generator.uniform(0.9, 1.1, 4)
    phases = generator.uniform(0.0, 2.0 * np.pi, 4)
    sizes = size * np.array([1.0, 0.8, 0.5, 0.3])
    sines = np.sin(2.0 * np.pi * frequencies[:, None] * times + phases[:, None])
    return times, np.minimum(times / 0.3, 1.0) * (sizes @ sines)


NOISE = float(np.sqrt(1.0 + 1.0 / 12.0))
"""Noise of the encoder in counts: one count, and the error of rounding."""


def log_table(joint, times, torques, side="elbow", start=0.0, seed=0):
    """The log as a table, with the counts of the encoder of one side of the gear."""
    rotor, link = joint.motion(times, CubicSpline(times, torques, bc_type="natural"), start)
    angles = {"elbow": link, "elbow motor": rotor}[side]
    exact = angles * COUNTS / (2.0 * np.pi)
    counts = np.round(exact + np.random.default_rng(seed).standard_normal(len(times)))
    return pd.DataFrame({"t [ms]": 1e3 * times, "counts": 2048 + counts, "i [mA]": 200.0 * torques})
