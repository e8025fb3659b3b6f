"""The robot of `studies.robots.geared_joint`: an arm that hangs from an elbow."""

from pathlib import Path

import clearjoint as cj
from studies.robots.geared_joint import URDF


def rig(folder: Path, inertia: float = 0.01, axis: str = "0 1 0") -> cj.results.Robot:
    """Write the file of the robot, "rig.urdf", to a folder, and return the robot without drives.

    `inertia`: of the arm about its centre, kg m^2. `axis`: of the joint, as in the file.
    """
    file = folder / "rig.urdf"
    file.write_text(URDF.format(inertia=inertia).replace("0 1 0", axis))
    return cj.load_robot(file)
