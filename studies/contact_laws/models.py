"""Models of the double pendulum's shoulder, from an ideal joint to compliant contact."""

import abc
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import clearjoint as cj

CLEARANCE, RESTITUTION = 0.5e-3, 0.9
SHOULDER, BASES, ARMS = "shoulder", ("V", "W"), ("arm 2", "arm 3")
DESIGN_SPEED = 0.1
"""Entry speed of the first impact, m/s, for which the damping without entry speed is set."""
SAVED = 1e-3
"""Interval between saved instants, s."""


@dataclass(frozen=True)
class Impacts:
    """Energy lost in a run, J, entry speeds of its impacts, m/s, and forces, N, or ``None``."""

    lost: float
    speeds: np.ndarray
    forces: np.ndarray | None


@dataclass(frozen=True)
class AbstractModel(abc.ABC):
    """A model of the shoulder."""

    name: str

    @property
    def moves(self) -> bool:
        """Whether the motion depends on the clearance."""
        return True

    @abc.abstractmethod
    def scene(self) -> tuple[cj.Scene, cj.State]:
        """Return the double pendulum and its initial state."""

    @abc.abstractmethod
    def run(self, scene: cj.Scene, state: cj.State, end: Any, save: cj.Saving | None = None) -> Any:
        """Simulate up to a time, s."""

    @abc.abstractmethod
    def steps(self, solution: Any) -> int:
        """Return the number of attempted steps."""

    @abc.abstractmethod
    def impacts(self, scene: cj.Scene, state: cj.State, end: float) -> Impacts:
        """Return the energy lost and the impacts of a run."""

    def varied(self, logarithm: Any) -> tuple[cj.Scene, cj.State]:
        """Return the scene with its clearance multiplied by the exponential of a number."""
        scene, state = self.scene()
        clearance = CLEARANCE * jnp.exp(logarithm)
        return eqx.tree_at(lambda s: s.joints[SHOULDER].clearance, scene, clearance), state


@dataclass(frozen=True)
class AbstractSmoothModel(AbstractModel):
    """A model that `simulate` integrates with adaptive steps."""

    settings: cj.Settings = cj.presets.default

    def run(self, scene: cj.Scene, state: cj.State, end: Any, save: cj.Saving | None = None) -> Any:
        """Run `simulate`."""
        return cj.simulate(scene, state, end, self.settings, save, progress=False)

    def steps(self, solution: Any) -> int:
        """Return the number of attempted steps."""
        return int(solution.attempts)


@dataclass(frozen=True)
class Ideal(AbstractSmoothModel):
    """An ideal revolute joint."""

    @property
    def moves(self) -> bool:
        """Return false: there is no clearance."""
        return False

    def scene(self) -> tuple[cj.Scene, cj.State]:
        """Return the double pendulum without clearance."""
        return cj.mechanisms.double_pendulum(None)

    def impacts(self, scene: cj.Scene, state: cj.State, end: float) -> Impacts:
        """Return no impacts, and the reactions of the joint as forces."""
        return _bound(self, scene, state, end)


@dataclass(frozen=True)
class Massless(AbstractSmoothModel):
    """A massless link: both bases keep contact from the lowest point on."""

    def scene(self) -> tuple[cj.Scene, cj.State]:
        """Return the scene with the link, both arms lowered by the clearance."""
        return self._scene(CLEARANCE)

    def varied(self, logarithm: Any) -> tuple[cj.Scene, cj.State]:
        """Return the scene and the start for the changed clearance."""
        return self._scene(CLEARANCE * jnp.exp(logarithm))

    def _scene(self, clearance: Any) -> tuple[cj.Scene, cj.State]:
        scene, state = cj.mechanisms.double_pendulum()
        link = cj.MasslessLink(
            cj.GROUND,
            "arm 2",
            clearance=clearance,
            journal_length=20e-3,
            journal_point=(-0.5, 0.0, 0.0),
        )
        joints = {SHOULDER: link, "elbow": scene.joints["elbow"]}
        return cj.Scene(scene.bodies, joints, gravity=scene.gravity), lowered(state, clearance)

    def impacts(self, scene: cj.Scene, state: cj.State, end: float) -> Impacts:
        """Return no impacts, and the reactions of the link as forces."""
        return _bound(self, scene, state, end)


@dataclass(frozen=True)
class Compliant(AbstractSmoothModel):
    """Compliant contact by a normal law."""

    law: cj.extend.AbstractContactLaw = cj.laws.LankaraniNikravesh(
        restitution=RESTITUTION, stiffness=cj.mechanisms.STEEL
    )

    def scene(self) -> tuple[cj.Scene, cj.State]:
        """Return the double pendulum with the law."""
        return cj.mechanisms.double_pendulum(CLEARANCE, law=self.law)

    def impacts(self, scene: cj.Scene, state: cj.State, end: float) -> Impacts:
        """Return the energy lost and the table of impacts."""
        solution = self.run(scene, state, end, cj.Saving(grid(end), impacts=True))
        energy, table = cj.observe(scene, solution).energies["mechanical"], solution.impacts
        return Impacts(energy[0] - energy[-1], table.entry_speed, table.peak_force)


@dataclass(frozen=True)
class Rigid(AbstractModel):
    """Rigid contact in steps of fixed length, s, with the restitution that the law delivers."""

    step: float = 1e-4

    def scene(self) -> tuple[cj.Scene, cj.State]:
        """Return the double pendulum with the paper's law."""
        return cj.mechanisms.double_pendulum(CLEARANCE, RESTITUTION)

    def run(self, scene: cj.Scene, state: cj.State, end: Any, save: cj.Saving | None = None) -> Any:
        """Run `simulate_nonsmooth`."""
        return cj.simulate_nonsmooth(scene, state, end, save, step=self.step)

    def steps(self, solution: Any) -> int:
        """Return the number of steps."""
        return int(solution.steps)

    def impacts(self, scene: cj.Scene, state: cj.State, end: float) -> Impacts:
        """Return impacts: steps with an impulse after one without, at the speed one step before."""
        times = np.linspace(0.0, end, round(end / self.step) + 1)
        solution = self.run(scene, state, end, cj.Saving(times))
        observed, speeds = cj.observe(scene, solution), []
        energy = observed.energies["kinetic"] + observed.energies["gravity"]
        for base in BASES:
            impulses: Any = solution.history[SHOULDER][base].impulse
            pushes = impulses[1:] > impulses[:-1]
            onsets = np.flatnonzero(pushes[1:] & ~pushes[:-1]) + 1
            speeds.append(observed.contacts[SHOULDER][base].penetration_rate[onsets])
        return Impacts(energy[0] - energy[-1], np.concatenate(speeds), None)


def _bound(model: AbstractModel, scene: cj.Scene, state: cj.State, end: float) -> Impacts:
    observed = cj.observe(scene, model.run(scene, state, end, cj.Saving(grid(end))))
    energy, force = observed.energies["mechanical"], observed.reactions[SHOULDER]["arm 2"].force
    return Impacts(energy[0] - energy[-1], np.zeros(0), np.linalg.norm(force, axis=1))


def grid(end: float) -> np.ndarray:
    """Return instants every millisecond, s."""
    return np.linspace(0.0, end, round(end / SAVED) + 1)


def lowered(state: cj.State, height: Any) -> cj.State:
    """Return a state with all bodies moved along +Y, m."""
    bodies = {
        name: eqx.tree_at(lambda b: b.position, body, body.position + jnp.array([0, height, 0]))
        for name, body in state.bodies.items()
    }
    return cj.State(bodies)


FIXED_DAMPING = cj.laws.MemorylessHuntCrossley(
    restitution=RESTITUTION, stiffness=cj.mechanisms.STEEL, design_speed=DESIGN_SPEED
)
MODELS: tuple[AbstractModel, ...] = (
    Ideal("ideal joint"),
    Massless("massless link"),
    Rigid("rigid, h = 2e-4 s", 2e-4),
    Rigid("rigid, h = 1e-4 s", 1e-4),
    Rigid("rigid, h = 2e-5 s", 2e-5),
    Compliant("compliant, fixed damping", law=FIXED_DAMPING),
    Compliant("compliant, paper's law"),
)
