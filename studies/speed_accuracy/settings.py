"""Settings of `simulate`, by family: one solver, with landing or without, from coarse to fine."""

from dataclasses import dataclass, replace

import diffrax

import clearjoint as cj
from studies.speed_accuracy.evaluations import LANDING
from studies.speed_accuracy.steppers import RungeKutta4, SemiImplicitEuler

TOLERANCES = tuple(10.0**-k for k in range(3, 12))
IMPLICIT_TOLERANCES = TOLERANCES[:3]
IMPLICIT_STEPS = 60_000
"""Attempts after which an implicit run is given up: each takes a tenth of a millisecond."""
STEPS = (1e-4, 5e-5, 2e-5, 1e-5, 5e-6, 2e-6, 1e-6)
"""s."""
EXPLICIT = (
    diffrax.Heun(),
    diffrax.Bosh3(),
    diffrax.Tsit5(),
    diffrax.Dopri5(),
    diffrax.Dopri8(),
)
IMPLICIT = (diffrax.Kvaerno3(), diffrax.Kvaerno5())


@dataclass(frozen=True)
class Setting:
    """`fineness`: "rtol 1e-6", or the step; `settings`: those of `simulate`."""

    solver: str
    lands: bool
    fineness: str
    settings: cj.Settings

    @property
    def family(self) -> str:
        """Solver and landing."""
        return f"{self.solver}, {'landing' if self.lands else 'not landing'}"

    def __str__(self) -> str:
        return f"{self.family}, {self.fineness}"


def adaptive(solver: diffrax.AbstractSolver, rtol: float, lands: bool = True) -> Setting:
    """Steps by a tolerance; implicit methods with the looser absolute one that they want."""
    implicit = isinstance(solver, diffrax.AbstractImplicitSolver)
    settings = cj.Settings(
        solver=solver,
        rtol=rtol,
        atol=rtol * (1e-3 if implicit else 1e-5),
        landing_tolerance=LANDING if lands else None,
    )
    if implicit:
        settings = replace(settings, max_steps=IMPLICIT_STEPS)
    return Setting(type(solver).__name__, lands, f"rtol {rtol:.0e}", settings)


def fixed(solver: diffrax.AbstractSolver, step: float) -> Setting:
    """Steps of one length, s. They do not land, or they would not be of one length."""
    settings = cj.Settings(
        solver=solver,
        controller=diffrax.ConstantStepSize(),
        first_step=step,
        landing_tolerance=None,
    )
    name = f"{type(solver).__name__}, fixed steps"
    return Setting(name, False, f"{step:.0e} s", settings)


def preset(name: str) -> Setting:
    """One of clearjoint's presets, the default of `simulate` among them."""
    return Setting(name, True, "preset", getattr(cj.presets, name))


def grid() -> list[Setting]:
    """All settings of the diagram."""
    found = [
        adaptive(solver, rtol, lands)
        for solver in EXPLICIT
        for lands in (True, False)
        for rtol in TOLERANCES
    ]
    found += [
        adaptive(solver, rtol, lands)
        for solver in IMPLICIT
        for lands in (True, False)
        for rtol in IMPLICIT_TOLERANCES
    ]
    return found + [
        fixed(solver, step) for solver in (RungeKutta4(), SemiImplicitEuler()) for step in STEPS
    ]


def quick_grid() -> list[Setting]:
    """Enough to see the study at work."""
    return [adaptive(diffrax.Bosh3(), rtol) for rtol in TOLERANCES[:3]]
