"""A geared joint with play, friction and gravity, simulated by SciPy: two inertias and a dead band.

A rotor with armature, dry and viscous friction is driven by a torque. A spring and damper with a
dead band of the play connects it with a link that hangs from the joint.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

RATE = 200.0
"""Samples per second of the log, Hz."""
COUNTS = 4096
"""Counts of the encoder, of 12 bits, per revolution."""
NOISE = float(np.sqrt(1.0 + 1.0 / 12.0))
"""Noise of the encoder in counts: one count, and the error of rounding."""
Angles = np.ndarray
URDF = """<robot name="rig"><link name="base"/>
<link name="arm"><inertial><origin xyz="0 0 -0.25"/><mass value="1"/>
<inertia ixx="0.01" iyy="{inertia}" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
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

    @property
    def weight(self) -> float:
        """Largest moment of gravity about the joint, N m."""
        return self.mass * 9.81 * self.length

    def at_rest(self, angle: float) -> Angles:
        """Return the angles and speeds of rotor and link, rad and rad/s, with the link at rest at
        an angle, where gravity presses it to a flank."""
        held = self.weight * np.sin(angle)
        ahead = np.sign(held) * 0.5 * self.play + held / self.stiffness
        return np.array([angle + ahead, angle, 0.0, 0.0])

    def rates(self, y: Angles, torque: float) -> Angles:
        """Return the time derivatives of angles and speeds for a torque on the rotor, N m."""
        rotor, link, rotor_speed, link_speed = y
        twist, rate, half = link - rotor, link_speed - rotor_speed, 0.5 * self.play
        gear = 0.0
        if twist > half:
            gear = max(self.stiffness * (twist - half) + self.flank_damping * rate, 0.0)
        elif twist < -half:
            gear = min(self.stiffness * (twist + half) + self.flank_damping * rate, 0.0)
        resisting = self.friction * np.tanh(rotor_speed / 1e-5) + self.damping * rotor_speed
        of_link = -self.weight * np.sin(link) - gear
        about_joint = self.inertia + self.mass * self.length**2
        of_rotor = (torque - resisting + gear) / self.armature
        return np.array([rotor_speed, link_speed, of_rotor, of_link / about_joint])

    def motion(
        self, times: np.ndarray, torque: Callable[[float], float], start: float = 0.0
    ) -> np.ndarray:
        """Return the angles of rotor and link, (2, N) rad, at times, (N,) s, for a torque as a
        function of time, from the link at rest at an angle."""
        solution = solve_ivp(
            lambda t, y: self.rates(y, torque(t)),
            (times[0], times[-1]),
            self.at_rest(start),
            method="LSODA",
            t_eval=times,
            rtol=1e-8,
            atol=1e-10,
            max_step=2e-3,
        )
        assert solution.success
        return solution.y[:2]


def swinging(seed: int, end: float, size: float = 0.9) -> tuple[np.ndarray, np.ndarray]:
    """Return times, s, and a signal of four sines of random phases, which begins within 0.3 s:
    torques, N m, or angles, rad."""
    generator = np.random.default_rng(seed)
    times = np.arange(round(end * RATE) + 1) / RATE
    frequencies = np.array([0.4, 0.9, 1.7, 2.9]) * generator.uniform(0.9, 1.1, 4)
    phases = generator.uniform(0.0, 2.0 * np.pi, 4)
    sizes = size * np.array([1.0, 0.8, 0.5, 0.3])
    sines = np.sin(2.0 * np.pi * frequencies[:, None] * times + phases[:, None])
    return times, np.minimum(times / 0.3, 1.0) * (sizes @ sines)


def counted(angles: np.ndarray, seed: int) -> np.ndarray:
    """Return angles, rad, as counts of the encoder, with its noise; 2048 is the angle zero."""
    exact = angles * COUNTS / (2.0 * np.pi)
    noise = np.random.default_rng(seed).standard_normal(len(angles))
    return 2048 + np.round(exact + noise)


def log_table(
    joint: GearedJoint,
    times: np.ndarray,
    torques: np.ndarray,
    side: str = "elbow",
    start: float = 0.0,
    seed: int = 0,
) -> pd.DataFrame:
    """Return the log as a table, with the counts of the encoder of one side of the gear."""
    rotor, link = joint.motion(times, CubicSpline(times, torques, bc_type="natural"), start)
    counts = counted({"elbow": link, "elbow motor": rotor}[side], seed)
    return pd.DataFrame({"t [ms]": 1e3 * times, "counts": counts, "i [mA]": 200.0 * torques})
