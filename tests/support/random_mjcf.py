"""Robots at random, as MJCF files."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation


def text(numbers) -> str:
    return " ".join(map(repr, np.atleast_1d(np.asarray(numbers, dtype=float)).tolist()))


def frame(generator: np.random.Generator) -> str:
    quaternion = Rotation.random(rng=generator).as_quat(scalar_first=True)
    return f'pos="{text(generator.uniform(-1, 1, 3))}" quat="{text(quaternion)}"'


def random_box(generator: np.random.Generator, least: float = 0.2) -> tuple[float, np.ndarray]:
    """Mass, kg, and principal moments of inertia, kg m^2, of a box with sides up to 1 m."""
    sides, mass = generator.uniform(least, 1.0, 3) ** 2, generator.uniform(0.5, 5.0)
    return mass, mass * (sides.sum() - sides) / 12


def random_inertial(generator: np.random.Generator) -> str:
    mass, moments = random_box(generator)
    return f'<inertial mass="{text(mass)}" diaginertia="{text(moments)}" {frame(generator)}/>'


def random_body(generator: np.random.Generator, name: str, joint: str, inner: str) -> str:
    head = f'<body name="{name}" {frame(generator)}>{joint}'
    return f"{head}{random_inertial(generator)}{inner}</body>"


def random_joint(generator: np.random.Generator, name: str) -> str:
    kind = generator.choice(["hinge", "slide"])
    axis, point = generator.uniform(-1, 1, (2, 3))
    ref, rest = generator.uniform(-1, 1, 2)
    resistances = generator.uniform(0, 5, 3) * generator.integers(0, 2, 3)
    stiffness, damping, armature = map(text, resistances)
    return (
        f'<joint name="{name}" type="{kind}" axis="{text(axis)}" pos="{text(point)}" '
        f'ref="{text(ref)}" springref="{text(rest)}" stiffness="{stiffness}" '
        f'damping="{damping}" armature="{armature}"/>'
    )


def random_tree(generator: np.random.Generator, names: list[str], fixed: bool) -> str:
    """Bodies of random names on each other; some are fixed, and the first one never is."""
    inner: dict[int, str] = dict.fromkeys(range(len(names)), "")
    parents = [None, *(int(generator.integers(k)) for k in range(1, len(names)))]
    for k in reversed(range(len(names))):
        has_joint = k == 0 or not fixed or generator.random() < 0.6
        # With several joints, there are links without mass between them.
        count = generator.integers(1, 4) if has_joint else 0
        joints = [random_joint(generator, "also " * j + f"to {names[k]}") for j in range(count)]
        body = random_body(generator, names[k], "".join(joints), inner[k])
        if parents[k] is None:
            return body
        inner[parents[k]] += body
    raise AssertionError


def file_of(bodies: str, generator: np.random.Generator, rest: str = "") -> str:
    gravity = text(generator.uniform(-10, 10, 3))
    head = f'<compiler angle="radian"/><option gravity="{gravity}"/>'
    return f"<mujoco>{head}<worldbody>{bodies}</worldbody>{rest}</mujoco>"


def model_of(robot: str):
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(robot)
    return model, mujoco.MjData(model)
